"""Synchronization of flipped blocks and of chirality on planted problems.

    python -m tests.benchmarks.bench_synchronization [--seeds 10] [--only WORD ...]

Poses by noise, wrong pairs and graph are the experiment ``synchronization``.
"""

import argparse

import numpy as np

from collalign.synchronization import synchronize
from tests.synchronization_problems import (
    complete_edges,
    exact_pairs,
    group_flip,
    pose_errors_deg,
    random_rotations,
    regular_edges,
    small_rotations,
)


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


PARTS = {"blocks": blocks, "chirality": chirality}


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--only", nargs="*", choices=list(PARTS), default=list(PARTS))
    options = parser.parse_args(arguments)
    for name in options.only:
        PARTS[name](options.seeds)


if __name__ == "__main__":
    main()
