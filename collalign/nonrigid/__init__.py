"""Maps of deformable surfaces, arrays in, results out (Maron et al. 2016, section 6.1, and beyond).

* ``spectral_shape``: what a map needs of a surface
* ``tips``: ends of limbs, and ways to match them
* ``map_starts``: first maps, from signs of eigenfunctions and from matched tips
* ``functional_map``: ZoomOut
* ``refine``: to dense samples and all vertices
* ``portfolio``: candidate maps, best first
* ``regions``: regions of a whole surface that a cut one may be
* ``ranked``: candidate maps of two surfaces, and of regions if one is cut
* ``map_evidence``: how likely a map is
* ``common_bases``: consistent around cycles
* ``pose_maps``: poses judged by maps
* ``map_options``: options of both
"""
