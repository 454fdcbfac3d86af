"""Landmarks of a few specimens carried to all others, with error radii.

* ``run``: the entry
* ``carrier``: from templates to every specimen
* ``result``: what was carried
* ``slid``: semilandmarks
* ``disagreement``: tables and picture of what templates disagree on
* ``command``: prints and writes
"""
