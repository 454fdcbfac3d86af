"""Readers of mesh and point cloud formats, one module a format.

* ``raw_shape``: what each returns; polygons to triangles
* ``gltf``, ``npz``, ``obj_off_stl``, ``pcd``, ``ply``, ``vtk_legacy``, ``vtp``: named after their formats
* ``text_points``: which columns of a table are x, y and z; molecules

A new one is a function from a ``Source`` to a ``RawShape``. CONTRIBUTING.md walks through it.
"""
