"""Two shapes: poses, poses of parts, or a map between deformable surfaces; lists of pairs.

* ``rigid``: the best pose
* ``in_part``: surfaces that share a part
* ``on_whole``: a scan on its model
* ``nonrigid``: a map of bending shapes
* ``every_vertex``: the maps of all vertices, and which have no counterpart
* ``pictures``: of maps
* ``command``: prints and writes
"""
