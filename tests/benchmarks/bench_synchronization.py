"""Synchronization against the spectral baseline on planted problems.

    python -m tests.benchmarks.bench_synchronization [--seeds 10] [--only WORD ...]

Prints, per setting, the share of shapes within 20 degrees, the share of runs with all shapes right, the median and
the worst error, for both methods on the same data; then flipped blocks and chirality.
"""

import argparse
from dataclasses import dataclass

import numpy as np

from collalign.synchronization import synchronize
from tests.synchronization_problems import (
    complete_edges,
    exact_pairs,
    flipped_pairs,
    group_flip,
    pose_errors_deg,
    random_rotations,
    regular_edges,
    small_rotations,
)


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One setting of the planted problems; degree 0 is the complete graph."""

    degree: int
    wrong: float
    candidates: int
    num_shapes: int = 100
    kind: str = "flips"
    informative: bool = True

    @property
    def name(self):
        graph = f"degree {self.degree}" if self.degree else "complete"
        margins = "" if self.informative else ", no margins"
        return f"N {self.num_shapes}, {graph}, {self.kind} q {self.wrong}, {self.candidates} cand.{margins}"

    def problem(self, seed):
        edges = regular_edges(self.num_shapes, self.degree, seed) if self.degree else complete_edges(self.num_shapes)
        return flipped_pairs(
            np.random.default_rng(seed),
            edges,
            self.num_shapes,
            wrong=self.wrong,
            num_candidates=self.candidates,
            kind=self.kind,
            informative=self.informative,
        )


CELLS = [
    Cell(degree=0, wrong=0.5, candidates=1, kind="uniform"),
    Cell(degree=0, wrong=0.5, candidates=1),
    Cell(degree=0, wrong=0.5, candidates=4),
    Cell(degree=10, wrong=0.3, candidates=1),
    Cell(degree=10, wrong=0.3, candidates=4),
    Cell(degree=20, wrong=0.5, candidates=4),
    Cell(degree=10, wrong=0.5, candidates=4),
    Cell(degree=0, wrong=0.5, candidates=4, num_shapes=10),
    Cell(degree=6, wrong=0.3, candidates=1),
    Cell(degree=6, wrong=0.3, candidates=4),
    Cell(degree=20, wrong=0.5, candidates=4, informative=False),
    Cell(degree=10, wrong=0.3, candidates=4, informative=False),
    Cell(degree=10, wrong=0.0, candidates=1),
]


def poses(seeds):
    """Errors of both methods, and how far the confidence can be believed."""
    for cell in CELLS:
        rows = {"robust": [], "spectral": []}
        confidence = []
        for seed in range(seeds):
            problem = cell.problem(seed)
            for method, errors in rows.items():
                found = synchronize(problem.edges, problem.rotations, energies=problem.energies, method=method)
                errors.append(pose_errors_deg(found.rotations, problem.truth))
                if method == "robust":
                    confidence.append(found.confidence)
        print(cell.name)
        for method, errors in rows.items():
            table = np.array(errors)
            print(
                f"   {method:9s} within 20 deg {(table < 20).mean():.3f}  all right {(table < 20).all(1).mean():.2f}"
                f"  median {np.median(table, axis=1).mean():.2f}  worst {table.max():.1f}",
            )
        print("  ", calibration(np.concatenate(confidence), np.concatenate(rows["robust"]) < 20), flush=True)


def calibration(confidence, right):
    """How many of the shapes at .95 are right, and the area under the curve of wrong against right shapes."""
    sure = confidence >= 0.95
    stated = f"confident {sure.mean():.2f} of them right {right[sure].mean():.3f}" if sure.any() else "none confident"
    if right.all():
        return stated
    good, bad = confidence[right][:, None], confidence[~right]
    return f"{stated}  AUC {np.mean((good > bad) + 0.5 * (good == bad)):.3f}"


def blocks(seeds):
    """Whole groups flipped: right, or called certain."""
    for chance in (0.6, 0.45):
        within, sure = [], []
        for seed in range(seeds):
            problem, block = group_flip(
                np.random.default_rng(seed), complete_edges(100), 100, share=0.3, chance=chance
            )
            found = synchronize(problem.edges, problem.rotations)
            within.append((pose_errors_deg(found.rotations, problem.truth) < 20).mean())
            sure.append((found.confidence[block] >= 0.95).mean())
        print(
            f"30 % flipped as a group with probability {chance}: within 20 deg {np.mean(within):.3f}, of the block "
            f"called certain {np.mean(sure):.3f}",
            flush=True,
        )


def chirality(seeds):
    rows = {"robust": [], "spectral": []}
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        edges = regular_edges(100, 10, seed)
        truth = random_rotations(rng, 100, group="O")
        pairs = exact_pairs(truth, edges) @ small_rotations(rng, (len(edges),), 10.0)
        wrong = rng.random(len(edges)) < 0.3
        normals = rng.standard_normal((int(wrong.sum()), 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        pairs[wrong] = pairs[wrong] @ (np.eye(3) - 2 * normals[:, :, None] * normals[:, None])
        mirrored = np.linalg.det(truth) * np.linalg.det(truth[0]) < 0
        for method, right in rows.items():
            found = synchronize(edges, pairs, group="O", method=method)
            right.append(bool(np.array_equal(np.linalg.det(found.rotations) < 0, mirrored)))
    print(
        "chirality, degree 10, 30 % wrong signs: all right",
        {m: float(np.mean(r)) for m, r in rows.items()},
        flush=True,
    )


PARTS = {"poses": poses, "blocks": blocks, "chirality": chirality}


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--only", nargs="*", choices=list(PARTS), default=list(PARTS))
    options = parser.parse_args(arguments)
    for name in options.only:
        PARTS[name](options.seeds)


if __name__ == "__main__":
    main()
