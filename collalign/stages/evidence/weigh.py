"""The evidence stage: every pose of a pair, and crude poses besides, start a map; map and pose are weighed together.

The rotation of a map is a candidate of the pair beside its rigid poses, since parts that bend mislead closest points
more than they mislead maps. Each candidate keeps what every kind of evidence says of it.

Maps on few samples may mislead most pairs of a shape alike, and then no synchronization can tell. So the rival poses
of doubtful shapes, which their pairs vote for, are weighed anew by better maps: where surfaces are laid onto each
other, the right pose is first in more of the pairs.

Maps are only asked where they are worth their cost, which follows from how well the pairs match rigidly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, TypeAlias

import networkx as nx
import numpy as np

from collalign.confidence.candidate_model import (
    EVIDENCE,
    candidate_costs,
    cost_log_odds,
    evidence_score,
)
from collalign.engine.job import Job, Results, Wanted
from collalign.nonrigid.pose_maps import PoseMapper, axis_poses
from collalign.options import AlignOptions, AlignSession
from collalign.products.pair import Pair
from collalign.products.shapes import Shapes
from collalign.products.trust import UNCERTAIN
from collalign.stages.evidence.candidates import (
    PoseWeigher,
    candidates_laid,
    distinct_weighed,
    laid_surfaces,
)
from collalign.stages.evidence.map_surfaces import PREPARING, StoredSurface, prepare_surfaces
from collalign.stages.shape_stage import SAMPLING, refuse_lost, wanted_file
from collalign.stages.trust.rival_poses import MAX_PARTNERS
from collalign.whole_pairs.local_evidence import rigid_overlap
from data_tools.arrays import FloatArray, Holds, IntArray, read_only
from data_tools.embedding.embedding import Samples
from data_tools.errors import InputError, OptionsError
from data_tools.poses import APART_DEG, keep_apart
from data_tools.rotations import rotation_angle_deg

#: Maps are asked where the median of the pairs' lowest energies is above this share of the points' squared size.
#: Chosen on teeth, SCAPE and classes of SHREC07.
BENT_ENERGY = 0.16
#: And only where the pairs contradict each other: rigid evidence is settled where this share of the cycles of three
#: pairs closes. Of 12 mouse skulls and 12 glasses of SHREC07, whose energies are above, .95 and all close; of teddy
#: bears, ants, SCAPE and humans .46 to .74.
CLOSING_CYCLES = 0.9
#: And not where surfaces of the median pair overlap by this at rigid poses, as shapes with a stand do. So many
#: pairs are refined for that.
RIGID_OVERLAP, MOST_REFINED = 0.88, 24
#: Cycles that are looked at.
MAX_CYCLES = 2000


def wants_maps(options: AlignOptions, shapes: Shapes, pairs: Sequence[Pair]) -> bool:
    """Return whether the poses of maps join the pairs' candidates.

    Parameters
    ----------
    options : AlignOptions
    shapes : Shapes
    pairs : sequence of Pair
        With their first, rigid candidates.

    Raises
    ------
    OptionsError
        If maps are asked for beside an embedding or a synchronization that cannot use them.
    """
    able = options.synchronization == "robust" and not options.embedding.has_eigenfunctions
    if options.maps == "always" and not able:
        raise OptionsError(
            "maps: needs the robust synchronization and an embedding without eigenfunctions"
        )
    if options.maps != "auto" or not able:
        return options.maps == "always"
    if shapes.are_assembled:
        return False  # a map is of one component
    samples = shapes.samples
    rich = [
        pair for pair in pairs if not (samples[pair.target].is_poor or samples[pair.source].is_poor)
    ]
    pairs = rich or pairs
    is_weak = float(np.median([pair.energies.min() for pair in pairs])) > BENT_ENERGY
    return (
        is_weak and closing_share(pairs) < CLOSING_CYCLES and not _overlap_rigidly(samples, pairs)
    )


def _overlap_rigidly(samples: Sequence[Samples], pairs: Sequence[Pair]) -> bool:
    """Return whether the surfaces of the median pair overlap at its likeliest pose, refined."""
    by_energy = sorted(pairs, key=lambda pair: float(pair.energies.min()))
    overlaps = []
    for pair in by_energy[:: -(-len(by_energy) // MOST_REFINED)]:
        likeliest = int(np.argmin(candidate_costs(pair.energies, pair.mismatches)))
        overlaps.append(
            rigid_overlap(samples[pair.target], samples[pair.source], pair.rotations[[likeliest]])
        )
    return float(np.median(overlaps)) >= RIGID_OVERLAP


def closing_share(pairs: Sequence[Pair]) -> float:
    """Return the share of cycles of three pairs whose likeliest poses compose to nearly nothing; 0 without cycles."""
    best = {}
    for pair in pairs:
        rotation = pair.rotations[int(np.argmin(pair.energies)), :3, :3]
        best[pair.target, pair.source], best[pair.source, pair.target] = rotation, rotation.T
    graph = nx.Graph([(pair.target, pair.source) for pair in pairs])
    cycles = [
        (a, b, c)
        for a, b in sorted(tuple(sorted(edge)) for edge in graph.edges)
        for c in sorted(set(graph[a]) & set(graph[b]))
        if c > b
    ]
    chosen = cycles[:: -(-len(cycles) // MAX_CYCLES)] if cycles else []
    turns = [best[a, b] @ best[b, c] @ best[c, a] for a, b, c in chosen]
    return float(np.mean(rotation_angle_deg(np.stack(turns)) <= APART_DEG)) if turns else 0.0


#: Poses of a shape within this angle are one rival, and how many are tried beside the present pose.
SAME_RIVAL_DEG, NUM_RIVALS = 25.0, 3

#: What the pairs of one shape say about its pose in the common frame: poses (v, 3, 3), and the probability of each
#: candidate by its pair alone (v,).
Votes: TypeAlias = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class PairEvidence:
    """The poses that maps of a pair ask for, the best first, with the evidence of each."""

    rotations: Annotated[FloatArray, Holds(shape="m 3 3", rotations=True)]
    maps: Annotated[IntArray, Holds(shape="m k")]
    evidence: Annotated[FloatArray, Holds(shape=f"m {len(EVIDENCE)}")]

    def __post_init__(self) -> None:
        if not 0 <= self.maps.max(initial=-1) < self.maps.shape[1]:
            raise InputError(
                f"maps: holds no pose, or indices of more than {self.maps.shape[1]} samples"
            )


def weigh_pair(
    target: Samples,
    source: Samples,
    surfaces: tuple[StoredSurface, StoredSurface],
    group: str,
    starts: FloatArray,
    files: Sequence[Mapping[str, Any]] = (),
) -> PairEvidence:
    """Weigh poses of one pair and find those of its maps; runs inside a worker.

    Maps start from these poses, and from those of the principal axes and signs of eigenfunctions as well unless
    surfaces are laid onto each other, which takes longer.

    Parameters
    ----------
    target, source : Samples
    surfaces : (StoredSurface, StoredSurface)
    group : {"SO", "O"}
    starts : ndarray, shape (m, 3, 3)
        Poses that start maps.
    files : sequence of two mappings, optional
        Of both shapes, to lay their surfaces onto each other, see :func:`laid_surfaces`.
    """
    whole = laid_surfaces(files, [surface.area for surface in surfaces]) if files else []
    if whole:
        candidates = candidates_laid(target, source, whole, group, starts)
    else:
        to, of = (surface.posed for surface in surfaces)
        weigher = PoseWeigher(target, source, PoseMapper(to, of))
        if not files:
            starts = np.concatenate([starts, axis_poses(to, of, mirrored=group == "O")])
        candidates = [weigher.candidate_from(start) for start in starts]
        if not files:
            candidates += weigher.candidates_from_signs(mirrored=group == "O")
    rotations, maps, evidence = (
        np.stack(values) for values in zip(*distinct_weighed(candidates), strict=True)
    )
    return PairEvidence(rotations=rotations, maps=maps.astype(np.int32), evidence=evidence)


#: Weighs poses of a pair. The version changes whenever the same surfaces and poses would give other candidates.
WEIGHING = Job(kind="evidence", version="evidence-9", run=weigh_pair, reader=PairEvidence)


def weigh_pairs(session: AlignSession, shapes: Shapes, pairs: Sequence[Pair]) -> list[Pair]:
    """Return the pairs with the candidates of their maps, and with the log-odds and evidence of these.

    They have their first, rigid candidates, and the session's group is decided. Pairs whose shapes have no surface
    (point clouds) keep their candidates, with the log-odds of their energies.
    """
    own = {e: np.ascontiguousarray(pair.rotations[:, :3, :3]) for e, pair in enumerate(pairs)}
    weighed = [by_energy(pair) for pair in pairs]
    for e, found in weigh_starts(session, shapes, pairs, own, laid=False).items():
        weighed[e] = with_evidence(pairs[e], found)
    return weighed


def weigh_starts(
    session: AlignSession,
    shapes: Shapes,
    pairs: Sequence[Pair],
    starts: Mapping[int, FloatArray],
    *,
    laid: bool,
) -> Results[int, PairEvidence]:
    """Return what maps of some pairs make of some poses, by position of the pair, as :func:`weigh_pair` does.

    Parameters
    ----------
    session : Session
    shapes : Shapes
    pairs : sequence of Pair
    starts : mapping of int to ndarray (m, 3, 3)
        Poses of each pair that is to be weighed; pairs without surfaces are left out.
    laid : bool
        Whether surfaces are laid onto each other.
    """
    surfaces = prepare_surfaces(session, shapes)
    group, wanted = session.options.group, {}
    for e, poses in starts.items():
        i, j = pairs[e].target, pairs[e].source
        if i in surfaces and j in surfaces:
            ends = surfaces.shared(i), surfaces.shared(j)
            settings = {
                "group": group,
                "starts": poses.tolist(),
                "laid": laid,
            }
            files = (
                [wanted_file(PREPARING, session, shapes, end).arguments for end in (i, j)]
                if laid
                else ()
            )
            wanted[e] = Wanted(
                key=WEIGHING.key(settings, *(end.key for end in ends)),
                label=shapes.label(i, j),
                arguments={
                    "target": SAMPLING.shared(shapes.keys[i]),
                    "source": SAMPLING.shared(shapes.keys[j]),
                    "surfaces": ends,
                    "group": group,
                    "starts": poses,
                    "files": files,
                },
            )
    found = session.compute(
        WEIGHING, wanted, time_limit_s=session.run.pair_time_limit_s, strict=session.options.strict
    )
    if laid:  # of the files themselves
        refuse_lost(shapes, {i for e in found.failures for i in (pairs[e].target, pairs[e].source)})
    return found


def by_energy(pair: Pair) -> Pair:
    """Return the pair with log-odds by the energies of its candidates alone."""
    evidence = np.full((len(pair.energies), len(EVIDENCE)), np.nan)
    evidence[:, EVIDENCE.index("energy")] = pair.energies
    return replace(
        pair, log_odds=read_only(cost_log_odds(pair.energies)), evidence=read_only(evidence)
    )


def with_evidence(pair: Pair, found: PairEvidence) -> Pair:
    """Return a pair with the candidates of its maps behind its own, which no longer take part."""
    rotations = np.tile(np.eye(pair.rotations.shape[-1]), (len(found.rotations), 1, 1))
    rotations[:, :3, :3] = found.rotations
    energies = found.evidence[:, EVIDENCE.index("energy")]
    own, num = by_energy(pair), len(pair.energies)
    return replace(
        pair,
        how="map",
        rotations=read_only(np.concatenate([pair.rotations, rotations])),
        maps=read_only(np.concatenate([pair.maps, found.maps])),
        energies=read_only(np.concatenate([pair.energies, energies])),
        log_odds=read_only(np.concatenate([np.full(num, -np.inf), evidence_score(found.evidence)])),
        evidence=read_only(np.concatenate([own.evidence, found.evidence])),
    )


def weigh_doubtful_pairs(
    session: AlignSession,
    shapes: Shapes,
    pairs: Sequence[Pair],
    poses: FloatArray,
    confidence: FloatArray,
) -> list[Pair]:
    """Return the weighed pairs, those of each doubtful shape with the sure ones that match it best weighed anew.

    Their candidates become what the shape's pose and its rivals lead to where surfaces are laid onto each other. The
    right one is first in 184 of 228 such pairs of five classes, on which this was chosen, 147 by crude maps and 178
    by a full search. Poses are ``R_common_shape``, shape (N, 3, 3), confidences (N,).
    """
    near: dict[int, list[tuple[float, int]]] = {}
    for e, pair in enumerate(pairs):
        for own, other in ((pair.target, pair.source), (pair.source, pair.target)):
            if confidence[own] < UNCERTAIN <= confidence[other]:
                near.setdefault(own, []).append((float(pair.energies.min()), e))
    votes = votes_of(pairs, poses)
    starts: dict[int, FloatArray] = {}
    for own, ranked in near.items():
        rivals = voted_poses(votes[own], poses[own])
        for _, e in sorted(ranked)[:MAX_PARTNERS]:
            i, j = pairs[e].target, pairs[e].source
            starts[e] = np.swapaxes(rivals, 1, 2) @ poses[j] if own == i else poses[i].T @ rivals
    found = weigh_starts(session, shapes, pairs, starts, laid=True) if starts else {}
    return [with_evidence(pair, found[e]) if e in found else pair for e, pair in enumerate(pairs)]


def votes_of(pairs: Sequence[Pair], poses: FloatArray) -> list[Votes]:
    """Return what the pairs' candidates say about every shape, given the poses (N, 3, 3) of their other shapes."""
    found: list[list[Votes]] = [[] for _ in poses]
    for pair in pairs:
        chance = np.exp(pair.log_odds - pair.log_odds.max())
        chance /= chance.sum()
        relative = pair.rotations[:, :3, :3]
        found[pair.target].append((poses[pair.source] @ np.swapaxes(relative, 1, 2), chance))
        found[pair.source].append((poses[pair.target] @ relative, chance))
    return [
        (
            np.concatenate([votes for votes, _ in own] or [np.empty((0, 3, 3))]),
            np.concatenate([weights for _, weights in own] or [np.empty(0)]),
        )
        for own in found
    ]


def voted_poses(votes: Votes, pose: FloatArray) -> FloatArray:
    """Return the pose of a shape and the strongest other ones that its pairs vote for, shape (at most 4, 3, 3)."""
    voted, weights = votes
    flat = voted.reshape(-1, 9)
    close = 1.0 + 2.0 * np.cos(np.deg2rad(SAME_RIVAL_DEG))
    near = flat @ flat.T >= close
    support = near @ weights
    ranked = np.concatenate([pose[None], voted[np.argsort(-support, kind="stable")]])
    return ranked[keep_apart(ranked, SAME_RIVAL_DEG, num=NUM_RIVALS + 1)]
