"""What a surface is: cleaning, topology, normals, geodesics, Laplacian.

* ``shape``: ``Shape``, and the normals of its vertices
* ``cleaning``: repairs, decimation, which piece is the object
* ``outliers``: vertices that slipped, shapes of odd size
* ``extra``, ``hidden``: stands and plaster; walls inside
* ``topology``: edges, borders, areas, components
* ``closest``, ``triangle_tree``: closest points, and the tree that finds them
* ``point_features``: histograms of neighbourhoods
* ``joined``: the surface around several components
* ``geodesics``, ``laplacian``: distances along a surface; the Laplacian of meshes and clouds, with its eigenfunctions
"""
