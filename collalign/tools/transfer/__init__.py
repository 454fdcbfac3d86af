"""Landmarks of a few specimens carried to all others, with error radii.

* ``run``: the entry
* ``carrier``: from templates to every specimen
* ``posed_specimens``: the specimens as they lie, and why some are lost
* ``surface_points``: points that are carried beside the landmarks
* ``result``: what was carried
* ``slid``: semilandmarks
* ``disagreement``: tables and picture of what templates disagree on
* ``command``: prints and writes
"""
