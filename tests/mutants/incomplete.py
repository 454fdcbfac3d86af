"""Faults in what is said of incomplete shapes: bounds over shifts, margins that were not earned, marks that lack."""

from __future__ import annotations

from tests.mutants.place import Mutant, faults

_MOTIONS = ("tests/pairwise/branch_and_bound/test_motions.py",)
_MISSING = ("tests/end_to_end/test_missing_regions.py",)

INCOMPLETE: tuple[Mutant, ...] = (
    *faults(
        "pairwise/branch_and_bound/motion_bounds.py",
        _MOTIONS,
        ("MotionBounds.quasi", "values - turn_loss - self._allowance", "values - self._allowance"),
        ("MotionBounds.losses", "cells.reaches + 2.0 * half * self.lever", "cells.reaches"),
        ("MotionBounds.losses", "cells.reaches + 2.0 * half", "2.0 * half"),
        ("_lever", "np.linalg.norm(source.sum(axis=0)) +", "0.0 +"),
        ("_curvature", "points - points.mean(axis=0)", "0.1 * points"),
    ),
    *faults(
        "pairwise/branch_and_bound/reach.py",
        _MOTIONS,
        ("reach_bounds", "reaches[c] + chords[c] * lengths[j]", "chords[c] * lengths[j]"),
        ("reach_bounds", "reaches[c] + chords[c] * lengths[j]", "reaches[c]"),
        ("reach_bounds", "total -= savings.sum()", "total -= 0.0"),
    ),
    *faults(
        "pairwise/branch_and_bound/motion_search.py",
        _MOTIONS,
        (
            "MotionSearch._reach",
            "(energy - cost * unmatched) / (num - unmatched)",
            "(energy - cost * unmatched) / num",
        ),
        ("MotionSearch._threshold", "(1.0 - self._tol)", "(1.0 - 3.0 * self._tol)"),
        ("_octants", "0.5 * part.halves[:, None, None] * signs", "part.halves[:, None, None] * signs"),
    ),
    *faults(
        "collalign/confidence/overlap_model.py",
        ("tests/collalign/confidence/test_overlap_model.py",),
        ("rival_margin", "(means[apart] - means[0]).min", "(means[apart] - means[0]).max"),
        ("rival_margin", "> RIVAL_DEG", "> 0.0"),
        ("certainty", "np.sqrt(num_targets)", "1.0"),
    ),
    *faults(
        "collalign/registration/missing.py",
        _MISSING,
        ("missing_vertices", "(places.weights <= 0.0)", "(places.weights <= 1.0)"),
        ("mean_of_what_is_there", "np.where((total > 0)[:, None], mean, source)", "source"),
    ),
    *faults(
        "collalign/output/report/incomplete.py",
        ("tests/collalign/output/test_report_incomplete.py",),
        ("_missing_part", "lacks = ~own.has(carried)", "lacks = own.has(carried)"),
        ("_typical", "if not view.is_incomplete[i]", "if True"),
    ),
)
