"""How far reduced bodies are from the truth: the error of their meshes."""
