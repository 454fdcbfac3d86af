"""Shapes of which parts are missing: found, and posed on the complete ones by what has a counterpart.

* ``detect``: which ones
* ``posed_points``: their surfaces
* ``place``, ``add``: one on several others; all on the complete ones
* ``parts``: any as a part of the others, at any size
* ``scan_pairs``, ``scans``, ``join``: where none is complete: pairs, and all of them together
* ``on_model``: where one is, and all others are scans of it

Word: **incomplete**: of a shape of a collection that lacks parts, which are *missing*. *Partial* is of two surfaces
that share a part.
"""
