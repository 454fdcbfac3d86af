"""Every fitted model of what is right: a table of weights with its data, its figures and the command that fits it.

* ``pose_model``: of a shape
* ``candidate_model``: of the poses of a pair
* ``side_model``: left and right, and whether both sides are there
* ``overlap_model``: of surfaces that share a part
* ``incomplete_model``: of an incomplete shape
* ``map_model``: of a map
* ``kind_model``: of two shapes of one kind
* ``radius_model``: of a carried landmark
* ``reliability_model``: how often what is stated is right

A model takes evidence and returns a judgement; what gathers the evidence lies elsewhere. ``python -m experiments
calibrate`` fits or tries all of them again. A tuned number has its table here, or the module of its estimator, with
the collections that set it; its derivation is a module with ``CALIBRATION`` in ``experiments/calibration/``.

Word: **doubtful**: of a confidence below ``DOUBT``. *Uncertain* is below ``UNCERTAIN``, where a run matches further
pairs.
"""
