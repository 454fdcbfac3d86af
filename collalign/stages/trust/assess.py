"""The stage: pairs as first matched vote on each pose, and its rivals are tried on dense points."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from collalign.confidence.candidate_model import LEAST_COST, LEAST_MISMATCH, candidate_costs
from collalign.confidence.pose_model import (
    confidence_and_limits,
    cycle_log_odds,
    half_sure,
    is_as_good,
    noise_of_excess,
    pose_confidence,
    resembles_none,
)
from collalign.engine.job import Shared, table_of_values
from collalign.options import AlignSession
from collalign.products.pair import MAX_ALTERNATIVES, Alternative, Pair
from collalign.products.shapes import Constraints
from collalign.products.trust import (
    BLOCK_MARGIN,
    COLLECTION_VOTES,
    CYCLES,
    KINDS,
    LEAD,
    LOCAL_MARGIN,
    LOCAL_MISFIT,
    MARGIN,
    MISFIT,
    MISMATCH,
    VOTES,
    Trust,
)
from collalign.stages.self_symmetry import near_symmetries
from collalign.stages.trust.blocks import block_margins
from collalign.stages.trust.rival_poses import (
    MAX_PARTNERS,
    Partner,
    are_copies,
    leads_over,
    pose_costs,
    rival_poses,
)
from collalign.stages.trust.trust_notes import CONTRADICTED_VOTES
from collalign.synchronization import SynchronizationResult
from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only
from data_tools.embedding.embedding import Samples
from data_tools.poses import AGREE_DEG, APART_DEG, SAME_DEG, keep_apart, pose_angle_deg

#: What poses cost: gaps of dense points, and mismatches of neighbourhoods.
GAP, LOCAL = 0, 1
#: Added to the votes on either side (Jeffreys' prior). The second: pairs that contradict a pose and are taken to
#: ask for the same other one, before any is seen.
PRIOR_VOTES, PRIOR_SAME = 0.5, 10.0
#: Differences below this, in squared radii, say nothing.
RESOLUTION = 0.01
#: Odds of a rival against the others fall by this power of what it costs.
RIVAL_POWER = 6.0
#: Log-odds of a pair's candidates per unit of the logarithm of their costs, where these alone decide.
COST_LOG_ODDS = 8.0


def gather_trust(
    session: AlignSession,
    samples: Sequence[Samples],
    pairs: Sequence[Pair],
    rotations: FloatArray,
    components: Sequence[IntArray],
) -> Trust:
    """Gather the evidence about every pose.

    Pairs with a shape that resembles no other one, or has less than half as many points as the others, say little
    about the poses of the others, and are not counted.

    Parameters
    ----------
    session : Session
        Its group is decided.
    samples : sequence of Samples
    pairs : sequence of Pair
        As matched.
    rotations : ndarray, shape (N, 3, 3)
        The reported ``R_common_shape``.
    components : sequence of ndarray of int
        Shapes whose poses can be compared.
    """
    partners = partners_of(pairs, rotations)
    turns = _turns_of_parts(samples, partners, rotations, components)
    rivals = tuple(
        read_only(rival_poses(pose, own, turn))
        for pose, own, turn in zip(rotations, partners, turns, strict=True)
    )
    poses = [
        np.concatenate([pose[None], rivals[i], turns[i] @ pose]) for i, pose in enumerate(rotations)
    ]
    costs = _costs(session, samples, rotations, partners, poses)
    poor = np.array([one.is_poor for one in samples], dtype=np.bool_)
    left_out = poor | resembles_none(_fits(costs, components, poor))
    partners, costs = _among_relatives(partners, costs, left_out)
    excess, local_excess = ([_excess(cost[kind]) for cost in costs] for kind in (GAP, LOCAL))
    leads = [
        leads_over(pose, other[: len(rises)], own)
        for pose, other, rises, own in zip(rotations, rivals, excess, partners, strict=True)
    ]
    unknown = np.full((len(samples), len(KINDS)), np.nan)
    trust = Trust(
        evidence=unknown,
        rivals=rivals,
        excess=tuple(
            read_only(rises[: len(own)]) for rises, own in zip(excess, rivals, strict=True)
        ),
        local_excess=tuple(
            read_only(rises[: len(own)]) for rises, own in zip(local_excess, rivals, strict=True)
        ),
        leads=tuple(read_only(over) for over in leads),
        symmetries=_symmetries(samples, rotations, turns, costs, partners, components),
        up_to_symmetry=unknown,
    )
    apart = [np.eye(3)[None]] * len(samples)
    return replace(
        trust,
        evidence=_evidence(trust, costs, rotations, turns, partners, components, apart, poor),
        up_to_symmetry=_evidence(
            trust, costs, rotations, turns, partners, components, trust.symmetries, poor
        ),
    )


def _excess(costs: FloatArray) -> FloatArray:
    """Return the log of what other poses cost over what the first costs, means over all partners, shape (r,)."""
    if not costs.size:
        return np.zeros(0)
    means = costs[:, :-1].mean(axis=1)
    return np.asarray(np.log(means[1:] / means[0]))


def _symmetries(
    samples: Sequence[Samples],
    rotations: FloatArray,
    turns: Sequence[FloatArray],
    costs: Sequence[FloatArray],
    partners: Sequence[Sequence[Partner]],
    components: Sequence[IntArray],
) -> tuple[FloatArray, ...]:
    """Return for each shape the turns of its part after which this fits as well, the identity first.

    ``costs`` end with those of the poses that the turns lead to. Copies of a surface share its samples, which tell
    apart poses that look the same: where most partners of a surface are copies, its pairs are not asked. Nor are
    those of tables, which compare the same points: the noise of few points always prefers one of several equal
    poses. What the neighbourhoods of each shape say of the turned shape itself does not depend on its partners.
    """
    found = [read_only(np.eye(3)[None])] * len(turns)
    for members in components:
        known = [i for i in members if costs[i].size]
        if len(known) > 1 and len(turns[known[0]]):
            num = len(turns[known[0]])
            asked = [
                () if samples[i].is_table or _is_copied(samples[i], partners[i]) else partners[i]
                for i in known
            ]
            leads = [
                leads_over(rotations[i], turns[i] @ rotations[i], of)
                for i, of in zip(known, asked, strict=True)
            ]
            alike = is_as_good(
                np.mean([_excess(costs[i][GAP])[-num:] for i in known], axis=0),
                np.mean(leads, axis=0),
                np.mean([costs[i][LOCAL, -num:, -1] for i in known], axis=0) - LEAST_MISMATCH,
                float(np.mean([costs[i][LOCAL, 0, :-1].mean() for i in known])) - LEAST_MISMATCH,
                float(np.mean([_noise(samples[i], costs[i]) for i in known])),
            )
            repeatable = _repeatable(turns[known[0]], alike)
            for i in members:
                found[i] = read_only(np.stack([np.eye(3), *turns[i][repeatable]]))
    return tuple(found)


def _repeatable(turns: FloatArray, alike: BoolArray) -> BoolArray:
    """Return which turns (t, 3, 3) of those that seem ``alike`` (t,) are symmetries: each may be done again.

    A ship looks much the same after a turn about its long axis that brings it to no further such pose.
    """
    again = pose_angle_deg((turns @ turns)[:, None], turns) <= SAME_DEG
    while (stops := alike & (again & ~alike).any(axis=1)).any():
        alike = alike & ~stops
    return alike


def _noise(samples: Samples, costs: FloatArray) -> float:
    """Return what noise alone makes of the excess of a pose of a table; nothing of surfaces, which differ by more."""
    return noise_of_excess(samples.num_places, costs.shape[2] - 1) if samples.is_table else 0.0


def _is_copied(samples: Samples, partners: Sequence[Partner]) -> bool:
    """Return whether most partners of a surface are copies of it."""
    return samples.rim != "unknown" and are_copies(partners)


def _evidence(
    trust: Trust,
    costs: Sequence[FloatArray],
    rotations: FloatArray,
    turns: Sequence[FloatArray],
    partners: Sequence[Sequence[Partner]],
    components: Sequence[IntArray],
    alike: Sequence[FloatArray],
    poor: BoolArray,
) -> FloatArray:
    """Return the evidence about every pose, one row per shape; poses that ``alike`` (t, 3, 3) part count as one.

    ``turns`` are those of :func:`_turns_of_parts`, whose poses are the last that have costs. Of what the shapes of a
    part say together, ``poor`` ones (N,) say nothing.
    """
    evidence = _fits(costs, components, poor)
    agreeing = [_agreeing(alike[i] @ rotations[i], own) for i, own in enumerate(partners)]
    for i, own in enumerate(partners):
        poses = alike[i] @ rotations[i]
        if own:
            others = (pose_angle_deg(trust.rivals[i][:, None], poses) > APART_DEG).all(axis=1)
            margins = (
                least[i][others].min(initial=np.inf)
                for least in (trust.excess, trust.leads, trust.local_excess)
            )
            evidence[i, [MARGIN, LEAD, LOCAL_MARGIN]] = tuple(margins)
            evidence[i, VOTES] = (agreeing[i].sum() + PRIOR_VOTES) / (len(own) + 2.0 * PRIOR_VOTES)
    strange = poor | resembles_none(evidence)
    for members in components:
        known = members[~np.isnan(evidence[members, VOTES])]
        if len(known):
            related = known[~strange[known]] if not strange[known].all() else known
            evidence[known, COLLECTION_VOTES] = evidence[related, VOTES].mean()
            heard = related[evidence[related, VOTES] >= CONTRADICTED_VOTES]
            evidence[known, CYCLES] = _cycles(heard.tolist(), partners, agreeing)
            angles = pose_angle_deg(turns[known[0]][:, None], alike[known[0]])
            others = np.asarray((angles > APART_DEG).all(axis=1))
            every = (known,) if poor[known].any() else ()
            for some in (
                *every,
                related,
                heard,
            ):  # what its own pairs contradict is in nobody's block
                evidence[some, BLOCK_MARGIN] = _block_margins(some, costs, partners, others)
    return read_only(evidence)


def _block_margins(
    members: IntArray,
    costs: Sequence[FloatArray],
    partners: Sequence[Sequence[Partner]],
    others: BoolArray,
) -> FloatArray:
    """Return the block margins of some shapes over those of the part's turns that give ``others`` (t,) than its pose.

    The costs of the poses that the turns lead to are the last of each shape. Where neighbourhoods are not known of
    all, dense points stand for them.
    """
    place = {shape: at for at, shape in enumerate(members.tolist())}
    ends, tried = [], []
    for shape, at in place.items():
        against = costs[shape][:, [0, *range(-len(others), 0)], :-1].transpose(2, 1, 0)
        for partner, cost in zip(partners[shape], against, strict=False):
            if partner.shape in place:
                ends.append((at, place[partner.shape]))
                tried.append(np.log(cost))
    margins = np.full(len(members), np.inf)
    if tried:
        logs = np.stack(tried)
        if np.isnan(logs[..., LOCAL]).any():
            logs[..., LOCAL] = logs[..., GAP]
        before, *after = logs.sum(axis=2).T
        pairs = np.full((2, len(members), len(members)), np.nan)
        for cost in itertools.compress(after, others):
            pairs[:, *np.transpose(ends)] = cost - before, before
            margins = np.minimum(margins, block_margins(*pairs))
    return margins


def _fits(
    costs: Sequence[FloatArray], components: Sequence[IntArray], poor: BoolArray
) -> FloatArray:
    """Return how well each shape fits its partners, as evidence of which nothing else is known."""
    evidence = np.full((len(costs), len(KINDS)), np.nan)
    for i, cost in enumerate(costs):
        if cost.size:
            evidence[i, MISFIT] = np.log(cost[GAP, 0, :-1].mean())
            evidence[i, MISMATCH] = cost[LOCAL, 0, :-1].min() - LEAST_MISMATCH
    evidence[:, LOCAL_MISFIT] = np.log(evidence[:, MISMATCH] + LEAST_MISMATCH)
    for members in components:
        known = members[~np.isnan(evidence[members, MISFIT])]
        if len(known):
            usual = known[~poor[known]] if not poor[known].all() else known
            for kind in (MISFIT, LOCAL_MISFIT):
                evidence[known, kind] -= np.median(evidence[usual, kind])
    return evidence


def _among_relatives(
    partners: Sequence[list[Partner]], costs: Sequence[FloatArray], left_out: BoolArray
) -> tuple[list[list[Partner]], list[FloatArray]]:
    """Return the partners of each shape that are not left out, and its costs against these; one left out has all."""
    of_shapes, against = [], []
    for i, (own, cost) in enumerate(zip(partners, costs, strict=True)):
        related = np.array([not left_out[partner.shape] for partner in own], dtype=np.bool_)
        if left_out[i] or not related[:MAX_PARTNERS].any():
            related[:] = True
        of_shapes.append(
            [partner for partner, is_related in zip(own, related, strict=True) if is_related]
        )
        against.append(cost[:, :, np.append(related[:MAX_PARTNERS], True)] if cost.size else cost)
    return of_shapes, against


def _turns_of_parts(
    samples: Sequence[Samples],
    partners: Sequence[Sequence[Partner]],
    rotations: FloatArray,
    components: Sequence[IntArray],
) -> list[FloatArray]:
    """Return turns of the common frame that each part's most typical shape looks alike after, for every shape."""
    turns = [np.zeros((0, 3, 3))] * len(samples)
    for members in components:
        energies = [
            np.mean([partner.energy for partner in partners[i]] or [np.inf]) for i in members
        ]
        typical = int(members[int(np.argmin(energies))])
        frame = rotations[typical]
        found = frame @ near_symmetries(samples[typical]) @ frame.T
        for i in members:
            turns[int(i)] = found
    return turns


def partners_of(pairs: Sequence[Pair], rotations: FloatArray) -> list[list[Partner]]:
    """Return for each shape at ``R_common_shape`` (N, 3, 3) those that it was matched with, the best match first."""
    partners: list[list[Partner]] = [[] for _ in rotations]
    for pair in pairs:
        is_weighed = len(pair.log_odds) > 0
        if is_weighed:
            doubt = -pair.log_odds
        else:
            doubt = np.log(np.maximum(candidate_costs(pair.energies, pair.mismatches), LEAST_COST))
        order = np.argsort(doubt, kind="stable")
        order = order[np.isfinite(doubt[order])]
        turns, excess = pair.rotations[order, :3, :3], doubt[order] - doubt[order[0]]
        log_odds = -excess if is_weighed else -COST_LOG_ODDS * excess
        energy = float(pair.energies[order[0]])
        for own, other, relative in (
            (pair.source, pair.target, turns),
            (pair.target, pair.source, np.swapaxes(turns, 1, 2)),
        ):
            partners[own].append(
                Partner(
                    shape=other,
                    poses=rotations[other] @ relative,
                    excess=excess,
                    log_odds=log_odds,
                    energy=energy,
                )
            )
    return [sorted(own, key=lambda partner: (partner.energy, partner.shape)) for own in partners]


def _agreeing(poses: FloatArray, partners: Sequence[Partner]) -> BoolArray:
    """Return of which pairs the likeliest candidate asks for one of the poses (t, 3, 3), shape (p,)."""
    if not partners:
        return np.zeros(0, dtype=np.bool_)
    asked = np.stack([partner.poses[0] for partner in partners])
    return np.asarray(pose_angle_deg(asked, poses[:, None]).min(axis=0) <= AGREE_DEG)


def _cycles(
    members: Sequence[int], partners: Sequence[Sequence[Partner]], agreeing: Sequence[BoolArray]
) -> float:
    """Return the log-odds that pairs of some shapes know the poses. Copies of one another count as one shape.

    Pairs choose among as many poses as fit how often two of a shape that both ask for another pose ask for the same.
    Shapes that nearly all of their own pairs contradict, as those set by hand may be, are no ``members``.
    """
    original = {i: min([i, *(p.shape for p in partners[i] if p.energy == 0.0)]) for i in members}
    agreed: dict[tuple[int, int], list[bool]] = {}
    num_same, num_compared = PRIOR_SAME, PRIOR_SAME
    for i in members:
        others = []
        for partner, agrees in zip(partners[i], agreeing[i].tolist(), strict=True):
            if original.get(partner.shape, original[i]) == original[i]:
                continue
            both = sorted([original[i], original[partner.shape]])
            agreed.setdefault((both[0], both[1]), []).append(agrees)
            if not agrees:
                others.append(partner.poses[0])
        if len(others) > 1:
            first, second = np.triu_indices(len(others), 1)
            asked = np.stack(others)
            num_same += (pose_angle_deg(asked[first], asked[second]) <= AGREE_DEG).sum()
            num_compared += len(first)
    num_agreed = sum(float(np.mean(of_pair)) for of_pair in agreed.values())
    return cycle_log_odds(
        len({*original.values()}),
        len(agreed),
        len(agreed) - num_agreed,
        num_poses=1.0 + num_compared / num_same,
    )


def _costs(
    session: AlignSession,
    samples: Sequence[Samples],
    rotations: FloatArray,
    partners: Sequence[Sequence[Partner]],
    poses: Sequence[FloatArray],
) -> list[FloatArray]:
    """Return what every pose of every shape costs, each (2, 1 + r, p + 1), as :func:`pose_costs` does.

    Against its partners and last against itself as it lies; (2, 0, 0) where there are no partners.
    :data:`RESOLUTION` and :data:`LEAST_MISMATCH` are added.
    """
    shared = [Shared(key=str(i), reader=Samples) for i in range(len(samples))]
    tasks, places = {}, {}
    for i, own in enumerate(partners):
        chosen = [*(partner.shape for partner in own[:MAX_PARTNERS]), i]
        if own:
            distinct, places[i] = np.unique(poses[i].reshape(-1, 9), axis=0, return_inverse=True)
            tasks[i] = {
                "shape": shared[i],
                "poses": distinct.reshape(-1, 3, 3),
                "partners": tuple(shared[partner] for partner in chosen),
                "partner_poses": rotations[chosen],
            }
    with table_of_values(samples) as table:
        found = session.map_parallel("poses tried", pose_costs, tasks, shared=table)
    least = np.array([RESOLUTION, LEAST_MISMATCH])[:, None, None]
    return [
        found[i][:, places[i]] + least if i in found else np.zeros((2, 0, 0))
        for i in range(len(samples))
    ]


def confidence_by_evidence(trust: Trust | None, num: int) -> FloatArray:
    """Return the confidence (num,) that evidence alone gives each pose, whoever set it; NaN where none is."""
    return np.full(num, np.nan) if trust is None else pose_confidence(trust)


def times_side_chances(
    confidence: FloatArray, limited_by: Sequence[str], side_chances: Mapping[int, float]
) -> tuple[FloatArray, list[str]]:
    """Return confidences (N,), times the chances of sides that are in doubt, and what limits each."""
    confidence, limited_by = confidence.copy(), [*limited_by]
    for i, chance in side_chances.items():
        confidence[i], limited_by[i] = chance * confidence[i], "side"
    return confidence, limited_by


def with_trust(
    solution: SynchronizationResult,
    trust: Trust,
    constraints: Constraints,
    side_chances: Mapping[int, float] = MappingProxyType({}),
    seem_incomplete: Mapping[int, str] = MappingProxyType({}),
) -> tuple[SynchronizationResult, tuple[str, ...]]:
    """Return the solution with confidences and alternatives as the evidence has them, and what limits confidences.

    Poses set by hand are certain. Limits are the codes of :func:`confidence_and_limits`, those in
    ``seem_incomplete``, and ``side``.

    The odds of the rivals share what the reported pose leaves, by what they cost on dense points.
    ``side_chances`` are the chances that the side of a shape is right, where that is in doubt.
    """
    confidence, codes = confidence_and_limits(trust)
    limited_by = [*codes]
    for i, code in seem_incomplete.items():
        limit = float(half_sure(confidence[i]))
        if confidence[i] > limit:
            confidence[i], limited_by[i] = limit, code
    confidence, limited_by = times_side_chances(confidence, limited_by, side_chances)
    alternatives = []
    for i, (rivals, excess) in enumerate(zip(trust.rivals, trust.excess, strict=True)):
        share = np.exp(-RIVAL_POWER * (excess - excess.min())) if len(excess) else excess
        chances = (1.0 - confidence[i]) * share / max(share.sum(), LEAST_COST)
        order = [
            r for r in np.argsort(-chances, kind="stable") if confidence[i] > 0 and chances[r] > 0
        ]
        poses = rivals[order]
        chosen = tuple(
            Alternative(
                rotation=read_only(poses[r]),
                log_odds=float(np.log(confidence[i] / chances[order[r]])),
            )
            for r in keep_apart(poses, APART_DEG, num=MAX_ALTERNATIVES)
        )
        alternatives.append(chosen)
    for i in constraints.by_hand:
        confidence[i], limited_by[i] = 1.0, ""
    stated = replace(solution, confidence=read_only(confidence), alternatives=tuple(alternatives))
    return stated, tuple(limited_by)
