"""How the surfaces of a result vary: one page, meshes and tables."""
