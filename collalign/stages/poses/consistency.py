"""From pairs that partly contradict each other to one consistent collection: poses, maps, places and sizes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from collalign.collection import PairEvidence
from collalign.options import AlignOptions
from collalign.stages.pairs.match import MatchedPair
from collalign.stages.poses.agreement import agree, match_at, synchronize_as_published, turned
from collalign.stages.poses.parts import agree_in_parts
from collalign.stages.poses.placement import common_labels, in_label_order, place_and_scale
from collalign.stages.poses.refinement import refine_rotations
from collalign.synchronization import SynchronizationResult, principal_axes_gauge
from data_tools.arrays import FloatArray, IntArray, as_rotations, read_only
from data_tools.embedding.embedding import Samples
from data_tools.rotations import rotation_angle_deg


@dataclass(frozen=True, kw_only=True, eq=False)
class Consistency:
    """A consistent collection.

    Attributes
    ----------
    synchronization : SynchronizationResult
        Of the rotations of space, before their refinement.
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
    if options.synchronization == "spectral":
        solution = synchronize_as_published(samples, pairs, options, fixed=held, reference=reference)
    else:
        consent = agree if options.clusters == 1 else agree_in_parts
        pairs, solution = consent(samples, pairs, options, fixed=held, reference=reference)
    rotations = solution.rotations
    if (
        options.refine
        and options.synchronization == "robust"
        and all(len(item.dense_indices) > 1 for item in samples)
    ):
        rotations = _refined(samples, pairs, solution, options.group, held, reference)
    if options.gauge == "axes" and not held:
        posed = principal_axes_gauge([item.positions for item in samples], rotations)
        turn = posed[0] @ rotations[0].T
        rotations, solution = posed, turned(solution, np.tile(turn, (len(samples), 1, 1)))
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


def _refined(
    samples: Sequence[Samples],
    pairs: Sequence[MatchedPair],
    solution: SynchronizationResult,
    group: str,
    held: Mapping[int, FloatArray],
    reference: int,
) -> FloatArray:
    """Return the rotations refined by the pairs within connected parts, each part held where it is."""
    rotations = solution.rotations
    part = np.empty(len(samples), dtype=np.int64)
    anchors = dict(held)
    for number, members in enumerate(solution.components):
        part[members] = number
        if not set(members.tolist()) & held.keys():
            anchor = reference if reference in members else int(members[0])
            anchors[anchor] = rotations[anchor]
    within = [pair for pair in pairs if part[pair.target] == part[pair.source]]
    return refine_rotations(
        samples,
        rotations,
        np.array([(pair.target, pair.source) for pair in within]),
        np.array([match_at(samples, pair, rotations)[1] for pair in within]),
        group=group,
        fixed=anchors,
    )


def _evidence(
    samples: Sequence[Samples], pair: MatchedPair, e: int, solution: SynchronizationResult, rotations: FloatArray
) -> PairEvidence:
    """Return what is known about a pair, with its best match at the common poses."""
    point_map, energy = match_at(samples, pair, rotations)
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
