"""Poses of shapes that bend, averaged over several ways to measure the rotation of every pair.

Which rotation takes one bent shape to another depends on what is asked: maps follow the limbs, the first farthest
points are their tips, many points weigh the surface evenly. Each way errs in its own manner, and how much its
rotations contradict each other around cycles says how far it can be trusted. So every pair is measured in all ways,
each way is averaged alone to see its scatter, and then all are averaged together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from collalign.confidence.candidate_model import candidate_costs
from collalign.engine.job import table_of_values
from collalign.options import AlignSession
from collalign.products.pair import Pair
from collalign.stages.poses.agreement import solve_again
from collalign.synchronization import SynchronizationResult
from collalign.synchronization.averaging import average_frames, residuals_deg
from collalign.synchronization.frames import transposed
from collalign.whole_pairs.problem import pair_problem
from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only
from data_tools.embedding.embedding import Samples
from data_tools.poses import APART_DEG
from data_tools.rotations import rotation_angle_deg
from pairwise.local_search import minimise

#: Shares of the samples, in the order of farthest point sampling, whose energy is minimised: from the tips to all.
SHARES = (3 / 16, 1 / 4, 3 / 8, 1 / 2, 3 / 4, 1.0)
#: Fewer samples settle no rotation.
FEWEST_SAMPLES = 12
#: Trust in a way of measuring falls by this power of its scatter: 2 would be right if the ways erred independently.
#: Of 1 to 4 on three draws of SHREC07's humans and armadillos and one of its ants, glasses, teddy bears and fish, 1
#: and 4 are worse; 2 and 3 hardly differ but for the ants (median 4.0 and 3.5 deg), nor on SCAPE and TOSCA's centaur.
SCATTER_POWER = 3.0
#: No way scatters less than this, degrees.
LEAST_SCATTER_DEG = 0.1


def measure_pair(target: Samples, source: Samples, group: str, start: FloatArray) -> FloatArray:
    """Minimise the energy of a pair's first samples next to a rotation, for all shares; runs inside a worker.

    Returns
    -------
    ndarray, shape (s, 3, 3)
        ``R_target_source``, for each of :func:`numbers_of_samples`.
    """
    found = []
    for num in numbers_of_samples(len(target.positions)):
        problem = pair_problem(
            with_first_samples(target, num), with_first_samples(source, num), group
        )
        found.append(minimise(problem, start[None], hold_chirality=True).rotations[0])
    return np.stack(found)


def numbers_of_samples(most: int) -> list[int]:
    """Return how many samples are used, of so many: some shares of them, no number twice."""
    return sorted({min(most, max(FEWEST_SAMPLES, round(share * most))) for share in SHARES})


def with_first_samples(samples: Samples, num: int) -> Samples:
    """Return the first samples alone, centred and of unit size, with invariants that weigh what they did."""
    positions = samples.positions[:num] - samples.positions[:num].mean(axis=0)
    positions = read_only(positions / max(float(np.linalg.norm(positions)), np.finfo(float).tiny))
    weight = np.sqrt(len(samples.positions) / len(positions))
    return replace(
        samples,
        vertex_indices=samples.vertex_indices[:num],
        positions=positions,
        coordinates=positions,
        invariants=read_only(samples.invariants[:num] * weight),
    )


def bent_poses(
    session: AlignSession,
    samples: Sequence[Samples],
    pairs: Sequence[Pair],
    solution: SynchronizationResult,
    *,
    fixed: Mapping[int, FloatArray],
) -> FloatArray:
    """Return ``R_common_shape`` of the maps and of the energies of more and fewer samples together, shape (N, 3, 3).

    Parameters
    ----------
    session : Session
        Its group is decided.
    samples : sequence of Samples
    pairs : sequence of Pair
        Weighed, in space alone.
    solution : SynchronizationResult
        Of these pairs.
    fixed : mapping of int to ndarray (3, 3)
        Poses that stay, at least one in each part that the pairs connect.
    """
    edges = np.array([(pair.target, pair.source) for pair in pairs])
    asked = np.swapaxes(solution.rotations[edges[:, 0]], 1, 2) @ solution.rotations[edges[:, 1]]
    with table_of_values(samples) as table:
        minima = np.stack(solve_again(session, pairs, asked, table, measure_pair))
    maps = np.stack([_nearest_map(pair, pose) for pair, pose in zip(pairs, asked, strict=True)])
    measured = np.concatenate([maps[:, None], minima], axis=1)
    angles = rotation_angle_deg(measured, np.broadcast_to(asked[:, None], measured.shape))
    present = np.nan_to_num(angles, nan=np.inf) <= APART_DEG
    free = np.ones(len(samples), dtype=bool)
    free[list(fixed)] = False
    frames = transposed(solution.rotations)
    trust = np.array(
        [
            _trust(frames, edges, measured[:, [way]], present[:, way], free)
            for way in range(len(present.T))
        ]
    )
    return transposed(average_frames(frames, edges, measured, present * trust, free))


def _nearest_map(pair: Pair, asked: FloatArray) -> FloatArray:
    """Return the likeliest candidate near the common pose, or zeros where none is near."""
    angles = rotation_angle_deg(
        pair.rotations[:, :3, :3], np.broadcast_to(asked, (len(pair.rotations), 3, 3))
    )
    odds = pair.log_odds if len(pair.log_odds) else -candidate_costs(pair.energies, pair.mismatches)
    near = np.isfinite(odds) & (np.nan_to_num(angles, nan=np.inf) <= APART_DEG)
    if not near.any():
        return np.zeros((3, 3))
    return np.asarray(pair.rotations[int(np.argmax(np.where(near, odds, -np.inf))), :3, :3])


def _trust(
    frames: FloatArray, edges: IntArray, measured: FloatArray, present: BoolArray, free: BoolArray
) -> float:
    """Return how far one way of measuring is trusted: by its median residual, missing pairs being the largest."""
    alone = average_frames(frames, edges, measured, present[:, None].astype(np.float64), free)
    residuals = np.where(present, residuals_deg(alone, edges, measured)[:, 0], np.inf)
    return float(max(float(np.median(residuals)), LEAST_SCATTER_DEG) ** -SCATTER_POWER)
