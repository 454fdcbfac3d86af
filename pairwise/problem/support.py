"""Which matches can occur at all: the part of a mask that lies in some feasible assignment.

A convex relaxation over a mask has an interior point only on this part, so the solvers prune the rest first.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching

from data_tools.arrays import BoolArray, IntArray
from data_tools.errors import InputError


def assignment_support(allowed: BoolArray) -> tuple[BoolArray, BoolArray]:
    """Prune a mask to the matches that some feasible assignment uses.

    Alternating cycles through one feasible assignment: a match can occur iff its two ends lie in the same strongly
    connected component of the residual graph (Dulmage and Mendelsohn 1958), where one more node stands for "left
    free".

    Parameters
    ----------
    allowed : ndarray of bool, shape (n, k)
        Column j may go to row i. Every column must be assigned.

    Returns
    -------
    allowed : ndarray of bool, shape (n, k)
        Matches that occur in at least one feasible assignment.
    always_full : ndarray of bool, shape (n,)
        Rows that every feasible assignment fills.

    Raises
    ------
    InputError
        If no assignment fits.
    """
    n, k = allowed.shape
    matched = maximum_bipartite_matching(csr_array(allowed), perm_type="row").astype(np.int64)
    if (matched < 0).any():
        raise InputError(f"allowed: no assignment fits them, {int((matched < 0).sum())} points are left over")
    column_label, row_label, free_label = _residual_components(allowed, matched)
    usable = allowed & (row_label[:, None] == column_label[None, :])
    usable[matched, np.arange(k)] = True
    taken = np.zeros(n, dtype=bool)
    taken[matched] = True
    return usable, taken & (row_label != free_label)


def _residual_components(allowed: BoolArray, matched: IntArray) -> tuple[IntArray, IntArray, int]:
    """Return the strongly connected components of columns, rows and the node "free"."""
    n, k = allowed.shape
    free = k + n
    taken = np.zeros(n, dtype=bool)
    taken[matched] = True
    rows, cols = np.nonzero(allowed)
    tails = [cols, k + matched, k + np.flatnonzero(~taken), np.full(k, free)]
    heads = [k + rows, np.arange(k), np.full(int((~taken).sum()), free), k + matched]
    tail, head = np.concatenate(tails), np.concatenate(heads)
    graph = coo_array((np.ones(len(tail)), (tail, head)), shape=(free + 1, free + 1)).tocsr()
    _, labels = connected_components(graph, directed=True, connection="strong")
    return labels[:k], labels[k:free], int(labels[free])
