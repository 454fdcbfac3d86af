"""How the surfaces of a result vary: one page, meshes, tables and a figure."""
