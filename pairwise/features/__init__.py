"""Local evidence: poses on which neighbourhoods agree, and how much two surfaces overlap.

* ``poses``: poses on which descriptors of neighbourhoods agree
* ``overlap``: how well surfaces overlap at a pose, and which pose wins
* ``partners``: nearest points whose normals agree, compiled
* ``point_pairs``: poses of a part on its whole by votes of pairs of points
* ``votes``: votes of pairs of points, compiled
* ``on_whole``: the poses of a scan on its model, and whether it turns freely there
* ``depth_images``: poses by how far both reach, and conflicts with lines of sight

Words:

* **overlap**: of two surfaces at a pose, the share of either with a partner on the other, a point within 1.2 cells
  whose normal agrees. *Coverage* is that of one incomplete shape by all others.
* **mismatch**: of a pose of a pair, the mean distance of the descriptors of neighbourhoods at closest points, as a
  share of the median distance of any two. Smaller is better. It is neither energy nor gap.
"""
