"""How the surfaces of a result vary: one page, meshes and tables.

* ``run``: the entry
* ``surface_variation``: means, modes
* ``shape_model``, ``shape_statistics``: linear models, and their tests
* ``classification``: nearest neighbours
* ``mirror``: pairs of landmarks
* ``mean_landmarks``: on the mean, and on all
* ``landmark_blocks``: their integration
* ``repeats``: of individuals, and their sides
* ``posture``: taken out
* ``files``: page and tables
* ``command``: prints and writes
"""
