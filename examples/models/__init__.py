"""Models of the larger examples: shapes, partitions, and what of Exudyn joins them."""
