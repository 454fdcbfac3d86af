"""How the frames of two kinds lie to each other, as most of their pairs ask for: a chair stands like a sofa."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from collalign.confidence.candidate_model import candidate_costs
from collalign.options import AlignSession
from collalign.products.pair import Pair
from collalign.products.shapes import Shapes
from collalign.stages.choose_pairs import normalised
from collalign.stages.match_pairs import pairs_that_match
from collalign.stages.poses.placement import place_and_scale
from data_tools.arrays import FloatArray, IntArray
from data_tools.embedding.embedding import Samples
from data_tools.poses import APART_DEG
from data_tools.rotations import nearest_orthogonal, rotation_angle_deg

#: Kinds, the nearest, that each may get its frame from, and pairs of shapes between two kinds.
NUM_SOURCES, NUM_PAIRS = 2, 9
#: Kinds share a frame if at least this share of their pairs agree on one. Pairs that know nothing agree by chance:
#: two rotations are within :data:`APART_DEG` of each other with probability .008, but elongated shapes of any kinds
#: lie along each other, in one of four ways.
LEAST_AGREEING = 0.6
#: Votes against that are added to those of the pairs of which no two share a shape.
PRIOR = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class KindFrame:
    """How the frame of a kind lies.

    Attributes
    ----------
    rotation : ndarray, shape (3, 3)
        ``R_common_own``: from the frame of the kind to that of the kind of the reference.
    agreeing : float
        Share of the pairs that agree on it, less for few shapes: 1 for the kind of the reference, 0 where too few do.
    """

    rotation: FloatArray
    agreeing: float


def kind_frames(
    session: AlignSession,
    shapes: Shapes,
    kinds: Sequence[IntArray],
    rotations: FloatArray,
    log_odds: FloatArray,
    *,
    root: int,
    settled: Mapping[int, float],
) -> tuple[KindFrame, ...]:
    """Return how the frame of each kind lies, each by the kind that most pairs with it agree on, from the root on.

    Parameters
    ----------
    session : Session
    shapes : Shapes
    kinds : sequence of ndarray of int, each (n,)
        Positions of the shapes of each kind.
    rotations : ndarray, shape (N, 3, 3)
        ``R_own_shape``, of each shape in the frame of its kind.
    log_odds : ndarray, shape (N, N)
        How alike any two shapes are: the likest are matched.
    root : int
        The kind of the reference.
    settled : mapping of int to float
        Kinds whose frame stays as it is, and the share of pairs that agreed on it.
    """
    votes = _votes(session, shapes, kinds, rotations, log_odds)
    done = {
        kind: KindFrame(rotation=np.eye(3), agreeing=share)
        for kind, share in ({root: 1.0} | dict(settled)).items()
    }
    while len(done) < len(kinds):
        best = max(
            (
                (share * done[to].agreeing, to, of)
                for (to, of), (_, share) in votes.items()
                if to in done and of not in done
            ),
            default=(0.0, root, root),
        )
        share, to, of = best
        if share <= 0.0:
            break
        rotation = done[to].rotation @ votes[to, of][0]
        done[of] = KindFrame(rotation=rotation, agreeing=share)
    apart = KindFrame(rotation=np.eye(3), agreeing=0.0)
    return tuple(done.get(kind, apart) for kind in range(len(kinds)))


def lone_transform(sample: Samples, pose: FloatArray, scaling: str) -> FloatArray:
    """Return the transform (4, 4) of the only shape of a kind from a rotation (3, 3); one (4, 4) stays as it is."""
    if pose.shape == (4, 4):
        return pose
    labels = np.arange(len(sample.positions))[None]
    return place_and_scale([sample], pose[None], labels, scaling)[0]


def agreed_rotation(proposed: FloatArray, num: int) -> tuple[FloatArray, float]:
    """Return the rotation that most of some rotations (n, 3, 3) agree on, and the share that do; 0 for too few.

    Pairs of one shape with several of another kind agree because these are alike. So the share is that of as many
    votes as there are pairs of which no two share a shape, ``num``: one shape alone tells nothing.
    """
    angles = rotation_angle_deg(proposed[:, None], proposed[None])
    near = angles <= APART_DEG
    chosen = int(np.argmax(near.sum(axis=1)))
    mean = nearest_orthogonal(proposed[near[chosen]].sum(axis=0), determinant=1)
    share = float(near[chosen].mean()) * num / (num + PRIOR)
    return mean, share if share >= LEAST_AGREEING else 0.0


def _votes(
    session: AlignSession,
    shapes: Shapes,
    kinds: Sequence[IntArray],
    rotations: FloatArray,
    log_odds: FloatArray,
) -> Mapping[tuple[int, int], tuple[FloatArray, float]]:
    """Return the rotation from the second's frame to the first's of neighbouring kinds, both ways, and its share."""
    edges = {
        (one, other): _likest(kinds[one], kinds[other], log_odds)
        for one, other in _neighbours(kinds, log_odds)
    }
    every = normalised(np.array([pair for some in edges.values() for pair in some]).reshape(-1, 2))
    matched = pairs_that_match(session, shapes, every)
    by_ends = {(pair.target, pair.source): pair for pair in matched}
    found = dict[tuple[int, int], tuple[FloatArray, float]]()
    for (one, other), some in edges.items():
        proposed = [
            rotations[i] @ relative @ rotations[j].T
            for i, j in some
            if (relative := _relative(by_ends, i, j)) is not None
        ]
        # Of a pair whose shapes were reflected differently, nothing is known that keeps sides.
        proposed = [one for one in proposed if np.linalg.det(one) > 0]
        if proposed:
            num = min(len(proposed), len(kinds[one]), len(kinds[other]))
            mean, share = agreed_rotation(np.stack(proposed), num)
            found[one, other], found[other, one] = (mean, share), (mean.T, share)
    return found


def _relative(pairs: Mapping[tuple[int, int], Pair], i: int, j: int) -> FloatArray | None:
    """Return the likeliest ``R_i_j`` of a pair that keeps sides, by itself."""
    pair = pairs.get((min(i, j), max(i, j)))
    if pair is None:
        return None
    space = pair.rotations[:, :3, :3]
    costs = candidate_costs(pair.energies, pair.mismatches)
    proper = np.flatnonzero(np.linalg.det(space) > 0)
    if not len(proper):
        return None
    best = space[proper[int(np.argmin(costs[proper]))]]
    return np.asarray(best if pair.target == i else best.T)


def _neighbours(kinds: Sequence[IntArray], log_odds: FloatArray) -> list[tuple[int, int]]:
    """Return pairs of kinds that may share a frame: each with those that are most like it."""
    alike = np.full((len(kinds), len(kinds)), -np.inf)
    for one, own in enumerate(kinds):
        for other, of in enumerate(kinds):
            if one != other:
                table = log_odds[np.ix_(own, of)]
                alike[one, other] = table.max(axis=1).mean() + table.max(axis=0).mean()
    chosen = {
        (min(one, other), max(one, other))
        for one in range(len(kinds))
        for other in np.argsort(-alike[one], kind="stable")[:NUM_SOURCES].tolist()
        if one != other
    }
    return sorted(chosen)


def _likest(own: IntArray, of: IntArray, log_odds: FloatArray) -> list[tuple[int, int]]:
    """Return the most similar pairs of shapes of two kinds, of which no shape has more than its share."""
    table = log_odds[np.ix_(own, of)]
    most = (
        -(-NUM_PAIRS // min(len(own), NUM_PAIRS)),
        -(-NUM_PAIRS // min(len(of), NUM_PAIRS)),
    )
    counts = np.zeros(len(own)), np.zeros(len(of))
    chosen = list[tuple[int, int]]()
    for at in np.argsort(-table, axis=None, kind="stable").tolist():
        a, b = divmod(at, len(of))
        if counts[0][a] < most[0] and counts[1][b] < most[1] and len(chosen) < NUM_PAIRS:
            chosen.append((int(own[a]), int(of[b])))
            counts[0][a] += 1
            counts[1][b] += 1
    return chosen
