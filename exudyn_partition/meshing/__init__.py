"""FE models from shapes, meshes and files: NGSolve, meshio, STEP and input decks."""
