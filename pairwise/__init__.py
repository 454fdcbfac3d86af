"""Procrustes matching of two point sets: relaxations, certificates, search, refinement. Arrays in, results out.

* ``matching``, ``relaxations``: ``match`` and ``solve_relaxation``, the public entries
* ``options``, ``results``: what they take and return
* ``reexported``: types of ``data_tools`` that signatures here name
* ``problem``, ``rotation_pattern``: the Procrustes matching problem and its energy; the pattern of its rotations
* ``local_search``: local minimisation from given starts
* ``rotation_search``, ``rotation_sets``: the search over rotations, with the starts that it makes of a problem; sets
  of rotations that know no problem
* ``portfolio``: all ways of matching two shapes whole, ranked by energy: which candidates are kept
* ``pm_sdp``: the relaxation of the paper
* ``branch_and_bound``: proofs of the best pose
* ``certificates``: lower bounds that anybody can check
* ``features``: poses on which neighbourhoods agree, and overlap
* ``partial_match``, ``partial_counterparts``: poses of two surfaces that share a part, by search; what has a
  counterpart at many poses, and what it costs
* ``dense``, ``surface_fit``: dense points of surfaces and which are nearest at a pose; the fit of two whole surfaces,
  by their planes and by what they share

It knows no processes, and no files but certificates, and prints nothing.

Words:

* **candidate**: a pose of a pair that was found. What may be matched is *allowed*.
* **group**: ``SO`` or ``O``, rotations only or mirror images as well. Never a set of shapes.
* **component**: here, coordinates that the pattern of R connects. Of a mesh, what its edges connect; of a collection,
  shapes that pairs connect.
* **block**: coordinates that one rotation moves.
* **dense**: of more points of a surface than its samples.
* **partial**: of two surfaces that share a part. A shape of a collection that lacks parts is *incomplete*.
"""

import lazy_loader

# The names of the stub, each imported when it is first asked for: options alone are there in a third of the time.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
