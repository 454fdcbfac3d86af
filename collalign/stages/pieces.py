"""Which pieces of each shape are matched: its largest one, or all, as of objects that are assembled of parts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from collalign.confidence.candidate_model import candidate_chances
from collalign.options import AUTO, AlignSession
from collalign.products.pair import Pair
from collalign.products.shapes import Shapes
from collalign.stages.choose_pairs import identity_hashes, normalised, random_partners
from collalign.stages.match_pairs import pairs_that_match
from collalign.stages.steps import with_decided_group
from data_tools.arrays import BoolArray, IntArray
from data_tools.options import Components
from data_tools.poses import AGREE_DEG, pose_angle_deg
from data_tools.surface.cleaning import is_assembled

#: Pieces of some shapes, by name; the others are read as the options say.
Pieces: TypeAlias = Mapping[str, Components]
#: Mismatch of neighbourhoods that are not described: half of what any two have.
UNKNOWN_MISMATCH = 0.5
#: A pair that tells less than this of poses tells nothing.
LEAST_TOLD = 0.01
#: All pieces are the shape: the largest one takes their place where the mean pair tells more by this logarithm. Mean
#: pairs of guitars and guns tell more by .5 to .9, those of pianos, mugs, hammers, cars, desks and seats less, or by
#: up to .1; chosen on these.
LEAST_GAIN = 0.3
#: Random partners that each shape is matched with by either reading.
NUM_ASKED = 4


def pieces_that_match(
    session: AlignSession,
    shapes: Shapes,
    names: Sequence[str],
    read: Callable[[Pieces], Shapes],
) -> dict[str, Components]:
    """Return which of the shapes are read by all of their pieces, as their pairs would have it.

    Geodesics and spectra are of one surface, so that the largest piece poses most shapes best: the body of a guitar.
    The largest box of a chair says little. Where much of a shape is in other pieces, both readings of it are matched
    with some other shapes, and that one is taken by which its pairs tell poses apart better.

    Parameters
    ----------
    session : Session
    shapes : Shapes
        Read by their largest pieces.
    names : sequence of str
        Of these, and of shapes whose largest piece alone is no shape.
    read : callable
        Reads all shapes, those that it is given by other pieces.
    """
    assembled = assembled_shapes(session, shapes)
    if session.options.cleaning.like or not assembled:
        return {}
    whole = read(dict.fromkeys([*assembled, *({*names} - {*shapes.names})], "all"))
    lost = {*whole.names} - {*shapes.names}
    both = [name for name in whole.names if name not in lost]
    every = [
        reading.some([reading.names.index(name) for name in both]) for reading in (shapes, whole)
    ]
    has_two = np.array([name in assembled for name in both], dtype=np.bool_)
    asked = asked_pairs(every[0].keys, session.options.seed, has_two)
    by_largest, by_all = (_scores(session, reading, asked) for reading in every)
    is_whole = consistent_readings(has_two, by_largest, by_all)
    chosen = {*lost, *(name for name, by_pieces in zip(both, is_whole, strict=True) if by_pieces)}
    return dict.fromkeys(sorted(chosen), "all")


def assembled_shapes(session: AlignSession, shapes: Shapes) -> list[str]:
    """Return the shapes that are assembled of components, read by the largest, unless the options say which count."""
    if session.options.cleaning.components != AUTO:
        return []
    every = zip(shapes.names, shapes.samples, strict=True)
    return [name for name, samples in every if is_assembled(samples.notes)]


def consistent_readings(
    has_two: BoolArray,
    by_largest: Mapping[tuple[int, int], float],
    by_all: Mapping[tuple[int, int], float],
) -> BoolArray:
    """Return which shapes are read by all of their pieces, shape (N,).

    Each is read as most of its pairs would have it, then as those would that are read alike, until none changes. The
    same is done from all shapes read alike, and that is taken by which all pairs together tell most. A pair of which
    each shape is read in another way tells nothing. So shapes whose own pairs tell little follow the others.

    Parameters
    ----------
    has_two : ndarray of bool, shape (N,)
        The shapes of which there are two readings.
    by_largest, by_all : mapping of (int, int) to float
        How well each pair with such a shape tells poses apart by either reading; one that cannot be matched does not.
    """
    pairs = {
        pair: (by_largest.get(pair, 0.0), by_all.get(pair, 0.0) + LEAST_GAIN)
        for pair in sorted(by_largest.keys() | by_all.keys())
    }
    told: list[dict[int, tuple[float, float]]] = [{} for _ in has_two]
    for (i, j), either in pairs.items():
        told[i][j] = told[j][i] = either

    def settled(is_whole: BoolArray) -> BoolArray:
        for _ in range(len(has_two)):
            before = is_whole.copy()
            for i in np.flatnonzero(has_two).tolist():
                of_largest = sum(by[0] for j, by in told[i].items() if not is_whole[j])
                of_all = sum(by[1] for j, by in told[i].items() if is_whole[j] or not has_two[j])
                is_whole[i] = of_all >= of_largest
            if (is_whole == before).all():
                break
        return is_whole

    def told_by_all_pairs(is_whole: BoolArray) -> float:
        has_all = is_whole | ~has_two
        of_all = sum(by[1] for (i, j), by in pairs.items() if has_all[i] and has_all[j])
        return of_all + sum(
            by[0] for (i, j), by in pairs.items() if not (is_whole[i] or is_whole[j])
        )

    likelier = [sum(all_ - one for one, all_ in own.values()) >= 0.0 for own in told]
    starts = (has_two & likelier, has_two.copy(), np.zeros_like(has_two))
    return max(map(settled, starts), key=told_by_all_pairs)


def asked_pairs(keys: Sequence[str], seed: int, has_two: BoolArray) -> IntArray:
    """Return the pairs that are matched by either reading: those of shapes of two with a few random ones, (E, 2).

    Parameters
    ----------
    keys : sequence of str
        Of the shapes' records: which pairs there are depends on them and on the seed alone.
    seed : int
    has_two : ndarray of bool, shape (N,)
        The shapes of which there are two readings.
    """
    everyone = np.arange(len(keys))
    named = normalised(random_partners(identity_hashes(keys, seed), everyone, everyone, NUM_ASKED))
    return named[has_two[named].any(axis=1)]


def _scores(session: AlignSession, shapes: Shapes, asked: IntArray) -> dict[tuple[int, int], float]:
    """Return how well each of the pairs (E, 2) tells poses apart, by the positions of the shapes."""
    pairs = pairs_that_match(with_decided_group(session, session.options.group), shapes, asked)
    return {(pair.target, pair.source): tells_apart(pair) for pair in pairs}


def tells_apart(pair: Pair) -> float:
    """Return how well a pair tells poses apart, a logarithm, 0 where it does not.

    It is that of the chance of its likeliest pose, less where surfaces mismatch there. The largest boxes of two
    chairs match, but in four poses. All boxes together match worse, in one.
    """
    chances = candidate_chances(pair)
    best = int(np.argmax(chances))
    alike = pose_angle_deg(pair.rotations[:, :3, :3], pair.rotations[best, :3, :3]) <= AGREE_DEG
    known = len(pair.mismatches) and not np.isnan(pair.mismatches[best])
    mismatch = float(pair.mismatches[best]) if known else UNKNOWN_MISMATCH
    told = float(chances[alike].sum()) * (1.0 - mismatch)
    return float(np.log(max(told, LEAST_TOLD) / LEAST_TOLD))
