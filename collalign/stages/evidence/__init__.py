"""Further evidence of a pair's poses: dense points, normals, and the non-rigid maps that the poses start.

* ``map_surfaces``: prepared surfaces
* ``candidates``: of maps, or of the search in small collections, with all evidence
* ``weigh``: whether maps are worth it; pairs, and doubtful ones anew

Word: **evidence**: numbers that support or contradict poses and maps, and ``evidence.npz``, which keeps what report
and exports show of them. It is not what is proven. CONTRIBUTING.md walks through a new piece of it.
"""
