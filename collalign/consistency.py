"""From pairs that partly contradict each other to one consistent collection: poses, maps, places and sizes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from collalign.collection import PairEvidence
from collalign.options import AlignOptions
from collalign.pairs import MatchedPair, candidate_arrays, pair_problem, synchronize_pairs
from collalign.refinement import refine_rotations
from collalign.synchronization import SynchronizationResult, refine_with_pairs, superimpose, synchronize_maps
from data_tools.arrays import FloatArray, IntArray, as_rotations, read_only
from data_tools.embedding import Samples
from data_tools.rotations import rotation_angle_deg
from pairwise.local_search import LocalMinima, minimise


@dataclass(frozen=True, kw_only=True, eq=False)
class Consistency:
    """A consistent collection.

    Attributes
    ----------
    synchronization : SynchronizationResult
        Of the rotations in the embedding.
    rotations : ndarray, shape (N, 3, 3)
        ``R_common_shape``.
    transforms : ndarray, shape (N, 4, 4)
        File coordinates to the common frame.
    labels : ndarray of int, shape (N, k)
        Universe label of each sample.
    positions : ndarray, shape (N, k, 3)
        Samples in the common frame.
    consensus : ndarray, shape (num_labels, 3)
    pairs : tuple of PairEvidence
    """

    synchronization: SynchronizationResult
    rotations: FloatArray
    transforms: FloatArray
    labels: IntArray
    positions: FloatArray
    consensus: FloatArray
    pairs: tuple[PairEvidence, ...]


def make_consistent(
    samples: Sequence[Samples],
    pairs: Sequence[MatchedPair],
    options: AlignOptions,
    *,
    fixed: Mapping[str, ArrayLike],
    placed: Mapping[str, FloatArray] | None = None,
) -> Consistency:
    """Synchronize the pairs, label the samples consistently, and place and scale the shapes.

    Parameters
    ----------
    samples : sequence of Samples
    pairs : sequence of MatchedPair
    options : AlignOptions
    fixed : mapping of name to array_like (3, 3)
        ``R_common_shape`` set by hand.
    placed : mapping of name to ndarray (4, 4), optional
        Transforms that stay exactly as they are, of shapes whose rotation is fixed as well.
    """
    names = [item.name for item in samples]
    held = {names.index(name): as_rotations(pose, f"fixed[{name}]", dim=3) for name, pose in fixed.items()}
    reference = names.index(options.reference) if options.reference else 0
    pairs, solution = agree(samples, pairs, options, fixed=held, reference=reference)
    rotations = solution.rotations
    if options.refine and all(len(item.dense_indices) > 1 for item in samples):
        rotations = refine_rotations(
            samples,
            rotations,
            np.array([(pair.target, pair.source) for pair in pairs]),
            np.array([_match_at(samples, pair, rotations)[1] for pair in pairs]),
            group=options.group,
            fixed=held,
            reference=reference,
        )
    evidence = tuple(_evidence(samples, pair, e, solution, rotations) for e, pair in enumerate(pairs))
    labels = common_labels(samples, evidence, rotations)
    still = {names.index(name): transform for name, transform in (placed or {}).items()}
    transforms = place_and_scale(samples, rotations, labels, options.scaling, placed=still)
    positions = np.stack(
        [
            (item.positions * item.scale + item.offset) @ transform[:3, :3].T + transform[:3, 3]
            for item, transform in zip(samples, transforms, strict=True)
        ]
    )
    return Consistency(
        synchronization=solution,
        rotations=rotations,
        transforms=transforms,
        labels=labels,
        positions=positions,
        consensus=in_label_order(positions, labels).mean(axis=0),
        pairs=evidence,
    )


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
    if options.synchronization == "spectral":
        return list(pairs), solution
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


def common_labels(samples: Sequence[Samples], pairs: Sequence[PairEvidence], rotations: FloatArray) -> IntArray:
    """Label the samples of all shapes consistently, from the pairs' maps and the common poses.

    Parameters
    ----------
    samples : sequence of Samples
    pairs : sequence of PairEvidence
        With their maps at the common poses.
    rotations : ndarray, shape (N, 3, 3)
        ``R_common_shape``.

    Returns
    -------
    ndarray of int, shape (N, k)
        Each row a permutation of 0, ..., k - 1.
    """
    posed = [np.hstack([x.positions @ r.T, x.invariants]) for x, r in zip(samples, rotations, strict=True)]
    median = float(np.median([pair.energy for pair in pairs])) or 1.0
    found = synchronize_maps(
        {(pair.target, pair.source): pair.map_target_source for pair in pairs},
        [len(points) for points in posed],
        weights={(pair.target, pair.source): 1.0 / (1.0 + pair.energy / median) for pair in pairs},
        positions=posed,
    )
    return np.stack(found.labels)


def in_label_order(values: FloatArray, labels: IntArray) -> FloatArray:
    """Return per-sample values (N, k, m) so that row b of every shape carries label b."""
    return np.take_along_axis(values, np.argsort(labels, axis=1)[:, :, None], axis=1)


def place_and_scale(
    samples: Sequence[Samples],
    rotations: FloatArray,
    labels: IntArray,
    scaling: str,
    *,
    placed: Mapping[int, FloatArray] | None = None,
) -> FloatArray:
    """Return each shape's transform to the common frame: generalised Procrustes at the common rotations.

    Parameters
    ----------
    samples : sequence of Samples
    rotations : ndarray, shape (N, 3, 3)
    labels : ndarray of int, shape (N, k)
    scaling : {"similarity", "rigid"}
    placed : mapping of int to ndarray (4, 4), optional
        Transforms that stay; the other shapes are fitted to the mean of these.

    Returns
    -------
    ndarray, shape (N, 4, 4)
        File coordinates to the common frame. Without placed shapes the samples' mean is centred; with similarities
        the shapes' normalised sizes have a geometric mean of 1.
    """
    units = np.array([item.scale for item in samples])
    if placed:
        posed = np.stack([item.positions @ r.T for item, r in zip(samples, rotations, strict=True)])
        factors, centre = _fit_to_placed(samples, in_label_order(posed, labels), labels, placed)
        shifts = np.tile(centre, (len(samples), 1))
    else:
        clouds = [item.positions * (item.scale if scaling == "rigid" else 1.0) for item in samples]
        common = superimpose(clouds, list(labels), rotations, with_scale=scaling == "similarity")
        factors, shifts = common.scales, common.translations
    if scaling == "rigid":
        factors = units
    transforms = np.tile(np.eye(4), (len(samples), 1, 1))
    for i, item in enumerate(samples):
        transforms[i, :3, :3] = factors[i] / item.scale * rotations[i]
        transforms[i, :3, 3] = shifts[i] - transforms[i, :3, :3] @ item.offset
    for i, transform in (placed or {}).items():
        transforms[i] = transform
    return transforms


def _fit_to_placed(
    samples: Sequence[Samples], posed: FloatArray, labels: IntArray, placed: Mapping[int, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return the scales that fit every shape to the mean of the placed ones, and the centre of that mean."""
    still = []
    for i, transform in placed.items():
        raw = samples[i].positions * samples[i].scale + samples[i].offset
        still.append(in_label_order((raw @ transform[:3, :3].T + transform[:3, 3])[None], labels[i][None])[0])
    mean = np.mean(still, axis=0)
    centre = mean.mean(axis=0)
    return ((posed * (mean - centre)).sum(axis=(1, 2)) / (posed**2).sum(axis=(1, 2))), centre


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


def _match_at(samples: Sequence[Samples], pair: MatchedPair, rotations: FloatArray) -> tuple[IntArray, float]:
    """Return the best map of a pair at the common poses, and its energy."""
    target, source = samples[pair.target], samples[pair.source]
    rotation = rotations[pair.target].T @ rotations[pair.source]
    costs = cdist(source.positions @ rotation.T, target.positions, "sqeuclidean")
    costs += cdist(source.invariants, target.invariants, "sqeuclidean")
    rows, columns = linear_sum_assignment(costs)
    return columns.astype(np.int64), float(costs[rows, columns].sum())


def _evidence(
    samples: Sequence[Samples], pair: MatchedPair, e: int, solution: SynchronizationResult, rotations: FloatArray
) -> PairEvidence:
    """Return what is known about a pair, with its best match at the common poses."""
    point_map, energy = _match_at(samples, pair, rotations)
    choice = int(solution.edge_choice[e])
    common = rotations[pair.target].T @ rotations[pair.source]
    return PairEvidence(
        target=pair.target,
        source=pair.source,
        rotations=read_only(pair.rotations[:, :3, :3].copy()),
        energies=read_only(pair.energies),
        map_target_source=read_only(point_map),
        energy=energy,
        lower_bound=pair.lower_bound,
        status=pair.status,
        chirality_proven=pair.chirality_proven,
        choice=choice,
        inlier=bool(solution.edge_inlier[e]),
        disagreement_deg=float(rotation_angle_deg(pair.rotations[choice, :3, :3], common)),
    )
