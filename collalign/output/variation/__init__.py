"""What varies in a collection of surfaces: one page to look at, meshes, tables and a figure."""
