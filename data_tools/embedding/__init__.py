"""What is matched of a shape: samples and the coordinates they carry.

* ``embedding``: ``Samples``, made of a shape
* ``working_surface``: a smaller copy of a large surface, or the one around several components
* ``sampling``: farthest points
* ``invariants``: descriptors of samples
* ``surface_points``: even points with normals, and rims of clouds
* ``chirality``: of one surface
* ``copies``: shapes that are there twice

A new invariant is a function in ``invariants``, with its weight in ``EmbeddingOptions`` (``data_tools/options.py``),
its line in ``_descriptors`` of ``embedding``, and a higher version of ``SAMPLING`` in
``collalign/stages/shape_stage.py``.
"""
