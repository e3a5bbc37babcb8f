"""The finite element model: material, mesh, matrices, facets, and its partition into two regions (paper, eq. 11)."""
