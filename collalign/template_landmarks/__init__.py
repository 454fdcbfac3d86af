"""Landmarks of a few specimens (templates), to be carried to all others: arrays in, frozen results out.

* ``templates``: landmark files read
* ``on_surface``: whether landmarks lie on their template
* ``table``: landmarks, curves and patches of all templates as one
* ``consensus``: which templates are trusted, and whose order is another one
* ``sides``: left and right in labels
* ``carry``: along maps, several templates fused
* ``local_fit``: what is around a landmark, laid on
"""
