"""Which shapes of a collection are of one kind, and how the frames of kinds lie to each other.

* ``pose_free``: what shapes look like whatever their poses
* ``grouping``: shapes that are nearest kin
* ``find``: the kinds of a folder, by both and by how well pairs match
* ``plan``: what is aligned by itself
* ``kind_frames``: how kinds are rotated to each other
"""
