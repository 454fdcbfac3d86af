"""Blocks of landmarks, and how every two of them go together, as tables and in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from collalign.analysis.integration import two_block_pls
from collalign.analysis.procrustes import MIN_LABELS, generalized_procrustes
from collalign.analysis.shape_tests import holm
from collalign.tools.variation.shape_statistics import Rows
from data_tools.arrays import FloatArray
from data_tools.errors import InputError
from data_tools.names import known_names
from data_tools.notes import Note

#: Between the ends of a range of landmarks.
_TO = ".."
#: How blocks are superimposed: with all their landmarks as one shape, or each by itself.
TOGETHER, SEPARATELY = "together", "separately"
_HEADING: list[object] = [
    *("first", "second", "superimposed", "shapes", "landmarks_first", "landmarks_second"),
    *("r_PLS", "Z", "P", "P_Holm", "share_of_covariance"),
]


def read_blocks(asked: Sequence[str], names: Sequence[str]) -> dict[str, list[int]]:
    """Return the rows of the landmarks of every block.

    Parameters
    ----------
    asked : sequence of str
        As in :class:`collalign.statistics.ShapeTestOptions`; none, or two or more.
    names : sequence of str
        Of the landmarks, in order.

    Raises
    ------
    InputError
        If there is one block only, one has no name, no landmarks that are known, too few or the same as another one.
    """
    if asked and not names:
        raise InputError("blocks: are of landmarks; name files that have them (landmarks)")
    found = dict[str, list[int]]()
    for text in asked:
        block, _, words = (part.strip() for part in text.partition("="))
        if not block or not words:
            raise InputError(
                f"blocks: expected a name and landmarks, such as face=LM1..LM8, got {text!r}"
            )
        if block in found:
            raise InputError(f"blocks: there are two called {block!r}")
        rows = [row for word in words.split(",") for row in _rows(block, word.strip(), names)]
        found[block] = list(dict.fromkeys(rows))
        if len(found[block]) < MIN_LABELS:
            raise InputError(
                f"blocks: {block} has {len(found[block])} landmarks, {MIN_LABELS} at least are a shape"
            )
    if len(found) == 1:
        raise InputError("blocks: integration is between two blocks or more; name another one")
    for one, other in combinations(found, 2):
        if both := [names[row] for row in found[one] if row in found[other]]:
            raise InputError(
                f"blocks: {both[0]} is in {one} and in {other}, which would go together by that"
            )
    return found


def _rows(block: str, word: str, names: Sequence[str]) -> list[int]:
    """Return the rows of one landmark, or of a range."""
    is_range = _TO in word and word not in names
    ends = [end.strip() for end in word.split(_TO, 1)] if is_range else [word]
    meant = known_names("blocks", ends, names, kind="landmark")
    rows = [names.index(meant[end]) for end in ends]
    if rows[0] > rows[-1]:
        raise InputError(f"blocks: in {block}, {ends[0]} comes after {ends[-1]}")
    return [*range(rows[0], rows[-1] + 1)]


def integration_tests(
    names: Sequence[str], points: FloatArray, blocks: Mapping[str, Sequence[int]], **how: int
) -> tuple[dict[str, Rows], list[Note]]:
    """Test whether every two blocks of landmarks go together, by two-block partial least squares.

    Parameters
    ----------
    names : sequence of str, length N
    points : ndarray, shape (N, l, 3)
        Landmarks of the shapes, complete in the blocks.
    blocks : mapping of str to sequence of int
        Rows of the landmarks of each.
    **how : int
        ``permutations`` and ``seed``.

    Returns
    -------
    tables : dict of str to rows
        ``integration``, with a row for every two blocks and way to superimpose, and ``pls_scores``.
    notes : list of Note
        The results of blocks that are superimposed together, in words.
    """
    every = [row for rows in blocks.values() for row in rows]
    whole = np.full(points.shape, np.nan)
    whole[:, every] = generalized_procrustes(points[:, every])
    ways = {
        TOGETHER: {block: whole[:, rows] for block, rows in blocks.items()},
        SEPARATELY: {
            block: generalized_procrustes(points[:, rows]) for block, rows in blocks.items()
        },
    }
    scores: Rows = [["first", "second", "superimposed", "name", "score_first", "score_second"]]
    table, notes = [_HEADING], list[Note]()
    for way, shapes in ways.items():
        pairs = [*combinations(blocks, 2)]
        found = [
            two_block_pls(*(shapes[block].reshape(len(names), -1) for block in pair), **how)
            for pair in pairs
        ]
        adjusted = holm(np.array([one.p for one in found])).tolist()
        for pair, one, p in zip(pairs, found, adjusted, strict=True):
            counts = [len(blocks[block]) for block in pair]
            numbers = [one.r, one.z, one.p, p, float(one.shares[0])]
            table.append([*pair, way, len(names), *counts, *numbers])
            of_shapes = zip(names, *(axes[:, 0].tolist() for axes in one.scores), strict=True)
            scores += [[*pair, way, *row] for row in of_shapes]
            if way == TOGETHER:
                values = {"first": pair[0], "second": pair[1], "r": one.r, "z": one.z, "p": p}
                notes.append(Note("blocks-compared", values=values))
    return {"integration": table, "pls_scores": scores}, notes
