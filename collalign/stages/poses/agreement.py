"""How pairs and collection come to agree: the paper's alternation as published, and one that resists wrong pairs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from collalign.options import AlignOptions
from collalign.stages.pairs.match import MatchedPair, candidate_arrays, pair_problem, synchronize_pairs
from collalign.synchronization import SynchronizationResult, alternate_assignments, refine_with_pairs, synchronize
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.embedding.embedding import Samples
from pairwise.local.local_search import LocalMinima, minimise
from pairwise.problem.pattern import RotationPattern


def synchronize_as_published(
    samples: Sequence[Samples],
    pairs: Sequence[MatchedPair],
    options: AlignOptions,
    *,
    fixed: Mapping[int, FloatArray],
    reference: int,
) -> SynchronizationResult:
    """Synchronize exactly as appendix B of Maron et al. (2016) does, the baseline.

    The eigenprojection of the pairs' best rotations, block by block in mixed embeddings, then exact assignments of
    all pairs and rotations in closed form, in turn until nothing changes. Shapes set by hand stay where they are.

    Returns
    -------
    SynchronizationResult
        With rotations of space, shape (N, 3, 3).
    """
    blocks = samples[0].block_sizes
    pattern = RotationPattern.from_user(blocks if len(blocks) > 1 else None, sum(blocks), options.group)
    edges, rotations, energies = candidate_arrays(pairs)
    solution = synchronize(
        edges,
        rotations,
        energies=energies,
        group=options.group,
        method="spectral",
        num_shapes=len(samples),
        rotation_pattern=pattern,
        reference=reference,
    )
    frames, _, _ = alternate_assignments([item.coordinates for item in samples], solution.rotations, pattern=pattern)
    poses = np.ascontiguousarray(frames[:, :3, :3])
    anchor = next(iter(fixed.items()), (reference, np.eye(3)))
    poses = anchor[1] @ poses[anchor[0]].T @ poses
    for shape, pose in fixed.items():
        poses[shape] = pose
    return replace(solution, rotations=read_only(poses), reflected=read_only(np.linalg.det(poses) < 0))


def agree(
    samples: Sequence[Samples],
    pairs: Sequence[MatchedPair],
    options: AlignOptions,
    *,
    fixed: Mapping[int, FloatArray],
    reference: int,
) -> tuple[list[MatchedPair], SynchronizationResult]:
    """Synchronize, solve pairs again from the common poses where they disagree, until nothing changes.

    The paper's steps 2 to 4 (section 6.3 of Maron et al. 2016); a pair's energy may veto a pose.

    Returns
    -------
    pairs : list of MatchedPair
        Re-solved poses are appended to their candidates.
    solution : SynchronizationResult
        Its ``edge_choice`` counts the candidates of the returned pairs.
    """
    solution = synchronize_pairs(pairs, len(samples), options, fixed=fixed, reference=reference)
    edges, rotations, energies = candidate_arrays(pairs)
    found: dict[int, MatchedPair] = {}

    def resolve(edge: int, start: FloatArray) -> tuple[FloatArray, float, IntArray]:
        pose = _pose_from(samples, pairs[edge], start, options.group)
        found[edge] = replace(
            pairs[edge],
            rotations=np.concatenate([pairs[edge].rotations, pose.rotations]),
            maps=np.concatenate([pairs[edge].maps, pose.maps]),
            energies=np.concatenate([pairs[edge].energies, pose.energies]),
        )
        return np.ascontiguousarray(pose.rotations[0, :3, :3]), float(pose.energies[0]), pose.maps[0]

    refined = refine_with_pairs(
        edges,
        np.ascontiguousarray(rotations[..., :3, :3]),
        energies,
        resolve,
        group=options.group,
        num_shapes=len(samples),
        fixed=fixed,
        reference=reference,
        start=solution,
    )
    accepted = np.isfinite(refined.energies[:, -1])
    agreed = [found[e] if accepted[e] else pair for e, pair in enumerate(pairs)]
    last = np.array([len(pair.energies) - 1 for pair in agreed])
    resolved = refined.result.edge_choice == refined.energies.shape[1] - 1
    choice = read_only(np.where(resolved, last, refined.result.edge_choice))
    return agreed, replace(refined.result, edge_choice=choice)


def turned(solution: SynchronizationResult, turns: FloatArray) -> SynchronizationResult:
    """Return the solution with the pose of each shape, and its alternatives, turned in the common frame.

    Parameters
    ----------
    solution : SynchronizationResult
        Of rotations of space.
    turns : ndarray, shape (N, 3, 3)
        The same for all shapes of a connected part.
    """
    cuts = tuple(
        replace(cut, rotation=read_only(turns[cut.members[0]] @ cut.rotation @ turns[cut.members[0]].T))
        for cut in solution.weak_cuts
    )
    alternatives = tuple(
        tuple(replace(pose, rotation=read_only(turn @ pose.rotation)) for pose in poses)
        for turn, poses in zip(turns, solution.alternatives, strict=True)
    )
    symmetries = tuple(read_only(turns[0] @ symmetry @ turns[0].T) for symmetry in solution.symmetries)
    return replace(
        solution,
        rotations=read_only(turns @ solution.rotations),
        weak_cuts=cuts,
        alternatives=alternatives,
        symmetries=symmetries,
    )


def match_at(samples: Sequence[Samples], pair: MatchedPair, rotations: FloatArray) -> tuple[IntArray, float]:
    """Return the best map of a pair at the common poses, and its energy."""
    target, source = samples[pair.target], samples[pair.source]
    rotation = rotations[pair.target].T @ rotations[pair.source]
    costs = cdist(source.positions @ rotation.T, target.positions, "sqeuclidean")
    costs += cdist(source.invariants, target.invariants, "sqeuclidean")
    rows, columns = linear_sum_assignment(costs)
    return columns.astype(np.int64), float(costs[rows, columns].sum())


def _pose_from(samples: Sequence[Samples], pair: MatchedPair, start: FloatArray, group: str) -> LocalMinima:
    """Return the local minimum of a pair's energy next to a rotation of space."""
    target, source = samples[pair.target], samples[pair.source]
    problem = pair_problem(target, source, group)
    first = start
    if problem.dim > 3:
        # The eigenfunctions' block follows in closed form from the map that positions and invariants give.
        costs = cdist(source.positions @ start.T, target.positions, "sqeuclidean")
        costs += cdist(source.invariants, target.invariants, "sqeuclidean")
        first = problem.procrustes(linear_sum_assignment(costs)[1])
    return minimise(problem, first[None])
