"""Faults in branch and bound: bounds that are none, cells that do not cover, a status that was not earned."""

from tests.mutants.place import Mutant, faults

_T = "tests/pairwise/branch_and_bound/"
_BOUNDS = (_T + "test_bounds.py", _T + "test_prove.py")
_SEARCH = (_T + "test_search_of_rotations.py", _T + "test_prove.py")

BRANCH_AND_BOUND: tuple[Mutant, ...] = (
    *faults(
        "pairwise/branch_and_bound/cells.py",
        (_T + "test_cells.py",),
        ("Cells.balls", "np.pi * self.halves[:, 0] +", "0.9 * np.pi * self.halves[:, 0] +"),
        ("Cells.balls", "4.0 * np.arcsin", "3.6 * np.arcsin"),
        ("Cells.balls", "axis=2).max(axis=1)", "axis=2).mean(axis=1)"),
        ("Cells.split", "centres[2 * rows + 1, axes] += step", "centres[2 * rows + 1, axes] -= step"),
        ("Cells.split", "paths[1::2] += 1", "paths[1::2] += 0"),
        ("_quaternions", "0.25 * np.pi", "0.2 * np.pi"),
    ),
    *faults(
        "pairwise/branch_and_bound/bounds.py",
        _BOUNDS,
        ("QuasiBounds.__call__", "values - self._allowance - loss", "values - self._allowance - 0.9 * loss"),
        ("QuasiBounds.__init__", "np.where(problem.allowed, costs, np.inf)", "costs"),
        ("_chord", "4.0 * np.sin", "3.6 * np.sin"),
        ("_curvature", "len(target), 2)", "len(target), 1)"),
        ("_curvature", "(1.0 + 64.0 * _EPS)", "0.9"),
    ),
    *faults(
        "pairwise/branch_and_bound/assignment.py",
        (_T + "test_assignment.py",),
        ("_dual_value", "total += (size - k) * least", "total += least"),
        ("_augment", "+= finals[position] - length", "-= finals[position] - length"),
        ("_solve", "if value > wanted:\n            return np.inf\n        energy", "return np.inf\n        energy"),
    ),
    *faults(
        "pairwise/branch_and_bound/search.py",
        _SEARCH,
        ("RotationSearch.threshold", "(1.0 - self._tol)", "(1.0 - 100.0 * self._tol)"),
        ("RotationSearch.threshold", "return min(self.energy", "return max(self.energy"),
        ("RotationSearch.threshold", "self._within * best +", "0.9 * self._within * best +"),
        ("RotationSearch.is_done", "self.bound >= self.threshold(best)", "True"),
        ("RotationSearch.bound", "min(self._settled_bound, ", "max(self._settled_bound, "),
        ("RotationSearch.bound", "return min(self._settled_bound, ", "return min(self.energy, self._settled_bound, "),
        ("RotationSearch._split", "self._evaluate(rotations, radii,", "self._evaluate(rotations, 0.9 * radii,"),
        ("RotationSearch._split", "self._open.take(order[batch:])", "self._open.take(order[batch + 1 :])"),
        ("RotationSearch._settle", "cells.bounds >= self.threshold", "cells.bounds >= 0.9 * self.threshold"),
        ("RotationSearch._settle", "min(self._settled_bound, float", "max(self._settled_bound, float"),
        (
            "RotationSearch._settle",
            "cells.take(np.flatnonzero(is_small))",
            "cells.take(np.flatnonzero(is_smallest))",
        ),
    ),
    *faults(
        "pairwise/branch_and_bound/prove.py",
        (_T + "test_prove.py",),
        ("Proof.is_chirality_proven", "other > self.candidate.energy", "other > 0.5 * self.candidate.energy"),
        ("Proof.is_chirality_proven", "if self.candidate.reflected else", "if not self.candidate.reflected else"),
        ("_proof", "all(search.is_done", "any(search.is_done"),
        ("_proof", "PROVEN_OPTIMAL if is_proven else", "PROVEN_OPTIMAL if True else"),
        ("_proof", "min(*bounds.values(), best.energy)", "best.energy"),
        ("_proof", "min(*bounds.values(), best.energy)", "min(max(bounds.values()), best.energy)"),
    ),
    *faults(
        "pairwise/branch_and_bound/pose_lists.py",
        (_T + "test_poses.py",),
        ("PoseRegion.holds", "<= self.radii_rad", "<= 0.5 * self.radii_rad"),
        ("PoseList.candidates", "c.energy <= self.energy", "True"),
        ("list_poses", "is_resolved = time.monotonic() < deadline", "is_resolved = True"),
        ("_touching", "<= radii[first] + radii[second]", "<= 0.0 * radii[first]"),
    ),
    *faults(
        "pairwise/branch_and_bound/tilted.py",
        (_T + "test_tilted.py",),
        ("prove_tilted", "proof.lower_bound - offset - slack", "proof.lower_bound - slack"),
        ("with_tilt", "np.linalg.svd(0.5 * tilt)", "np.linalg.svd(tilt)"),
    ),
    *faults(
        "pairwise/certificates/verify_cells.py",
        ("tests/pairwise/certificates/test_verify_cells.py",),
        ("_chirality_bound", "(values - drop).min()", "(values - 0.5 * drop).min()"),
        ("_chirality_bound", "[first : first + chunk] * signs", "[first : first + chunk]"),
        ("_tiling", "if start != num_faces * end:", "if start > num_faces * end:"),
        ("_curvature", "roots * left.T / factor", "0.5 * roots * left.T / factor"),
    ),
    *faults(
        "pairwise/certificates/verify_joint.py",
        ("tests/pairwise/certificates/test_verify_joint.py",),
        ("gram_bound", "- float(np.trace(matrix))", "+ float(np.trace(matrix))"),
        ("largest_turns", "slack + len(matrix) * more", "0.3 * slack"),
    ),
    *faults(
        "collalign/tools/certify/multipliers.py",
        ("tests/collalign/tools/test_joint_bound.py",),
        ("JointMaster.run", "+ 0.5 * self.curvature", "- 0.5 * self.curvature"),
    ),
)
