"""The finite element model: material, mesh, matrices, facets, and what is divided off it as contact region."""
