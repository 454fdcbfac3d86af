"""Solving pairs again from the synchronized rotations, and synchronizing again, until nothing changes.

Steps 2 to 4 of the paper's algorithm (section 5), with a veto of the energies: a pair takes the pose that the
collection asks for only where its energy allows it, and keeps its own candidates besides.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from collalign.synchronization.problem.geometry import angles_rad, relative, transposed
from collalign.synchronization.problem.graph import PairGraph
from collalign.synchronization.result import SynchronizationResult
from collalign.synchronization.solve import synchronize
from data_tools.arrays import BoolArray, FloatArray, as_rotations, read_only
from data_tools.errors import InputError, OptionsError
from data_tools.threads import one_blas_thread
from pairwise.problem.pattern import PatternLike

#: ``resolve(edge, R_start) -> (R, energy, map)``: local minimisation of a pair from a starting rotation.
Resolve = Callable[[int, FloatArray], tuple[FloatArray, float, Any]]

#: A pair is solved again where its chosen candidate is off by more than this, radians.
SAME_POSE_RAD = np.deg2rad(1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class RefinedSynchronization:
    """Poses after pairs and collection agree.

    Attributes
    ----------
    result : SynchronizationResult
        Its ``edge_choice`` refers to ``rotations`` and ``energies`` here.
    rotations : ndarray, shape (E, m + 1, d, d)
        The candidates; the last one is the pair's re-solved pose.
    energies : ndarray, shape (E, m + 1)
        ``inf`` where a pair was never solved again, or the pose was vetoed.
    maps : dict of int to Any
        What ``resolve`` returned as map, by edge, for the last pose of each re-solved pair.
    vetoed : ndarray of bool, shape (E,)
        Pairs whose energy at the collection's pose is too high.
    rounds : int
    """

    result: SynchronizationResult
    rotations: FloatArray
    energies: FloatArray
    maps: dict[int, Any]
    vetoed: BoolArray
    rounds: int


@one_blas_thread()
def refine_with_pairs(
    edges: ArrayLike,
    rotations: ArrayLike,
    energies: ArrayLike,
    resolve: Resolve,
    *,
    weights: ArrayLike | None = None,
    group: str = "SO",
    num_shapes: int | None = None,
    rotation_pattern: PatternLike = None,
    fixed: Mapping[int, ArrayLike] | None = None,
    reference: int = 0,
    start: SynchronizationResult | None = None,
    max_rounds: int = 5,
    max_energy_ratio: float = 2.0,
) -> RefinedSynchronization:
    """Alternate synchronization with local minimisation of the pairs that disagree with it.

    Parameters
    ----------
    edges, rotations, energies, weights, group, num_shapes, rotation_pattern, fixed, reference
        As for :func:`synchronize`; energies are needed.
    resolve : callable
        ``resolve(edge, R_start) -> (R, energy, map)``.
    start : SynchronizationResult, optional
        Where one exists already.
    max_rounds : int
    max_energy_ratio : float
        A re-solved pose of more than this times the pair's lowest energy is vetoed, unless the pair has it already.

    Raises
    ------
    InputError
        If the arrays are not what :func:`synchronize` takes, or ``resolve`` returns no orthogonal matrix.
    OptionsError
        If ``max_energy_ratio`` is below one.
    """
    if not max_energy_ratio >= 1.0:
        raise OptionsError(f"max_energy_ratio: expected 1 or more, got {max_energy_ratio}")
    shared: dict[str, Any] = {"group": group, "num_shapes": num_shapes, "rotation_pattern": rotation_pattern}
    graph = PairGraph.from_user(edges, rotations, energies=energies, weights=weights, **shared)
    shared |= {"weights": weights, "fixed": fixed, "reference": reference}
    stack, costs = _with_room(graph)
    result = start or synchronize(edges, stack, energies=costs, **shared)
    maps: dict[int, Any] = {}
    vetoed = np.zeros(graph.num_edges, dtype=bool)
    rounds = 0
    while rounds < max_rounds:
        rounds += 1
        if not _resolve_pairs(graph, stack, costs, maps, vetoed, result, resolve, max_energy_ratio):
            break
        result = synchronize(edges, stack, energies=costs, **shared)
    return RefinedSynchronization(
        result=result,
        rotations=read_only(stack),
        energies=read_only(costs),
        maps=maps,
        vetoed=read_only(vetoed),
        rounds=rounds,
    )


def _with_room(graph: PairGraph) -> tuple[FloatArray, FloatArray]:
    """Return the candidates and energies with an absent candidate appended, where re-solved poses go."""
    if graph.energies is None:
        raise InputError("energies: needed, they decide which of the collection's poses a pair accepts")
    room = np.tile(np.eye(graph.dim), (graph.num_edges, 1, 1, 1))
    costs = np.where(graph.present, graph.energies, np.inf)
    return np.concatenate([graph.candidates, room], axis=1), np.pad(costs, ((0, 0), (0, 1)), constant_values=np.inf)


def _resolve_pairs(
    graph: PairGraph,
    stack: FloatArray,
    costs: FloatArray,
    maps: dict[int, Any],
    vetoed: BoolArray,
    result: SynchronizationResult,
    resolve: Resolve,
    max_energy_ratio: float,
) -> bool:
    """Solve again, in place, the pairs whose candidates are all off their synchronized rotation; say if any moved."""
    asked = relative(transposed(result.rotations), graph.edges)
    offered = np.isfinite(costs)
    away = np.stack([angles_rad(transposed(stack[:, k]) @ asked) for k in range(stack.shape[1])], axis=1)
    nearest = np.where(offered, away, np.inf).min(axis=1)
    changed = False
    for edge in np.flatnonzero(nearest > SAME_POSE_RAD):
        found, energy, found_map = resolve(int(edge), asked[edge].copy())
        pose = as_rotations(found, f"resolve({edge})", dim=graph.dim)
        lowest = float(costs[edge, :-1].min())
        vetoed[edge] = not energy <= max_energy_ratio * lowest
        known = angles_rad(stack[edge, offered[edge]].transpose(0, 2, 1) @ pose).min() <= SAME_POSE_RAD
        if vetoed[edge] or known:
            continue
        stack[edge, -1], costs[edge, -1], maps[int(edge)] = pose, energy, found_map
        changed = True
    return changed
