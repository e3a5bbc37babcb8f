"""Contact between reduced or full bodies: surfaces, gap rows, complementarity, and the laws on them."""
