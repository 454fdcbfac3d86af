"""Finding the poses of one component: eigenvectors, discrete rotations by beliefs, continuous refinement."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from collalign.synchronization.averaging import maximise_likelihood
from collalign.synchronization.graph import PairGraph, degrees
from collalign.synchronization.hypotheses import (
    Hypotheses,
    aligned_candidates,
    hypothesis_costs,
    propagate_beliefs,
    propose_hypotheses,
)
from collalign.synchronization.model import PRIORS, EdgeModel
from collalign.synchronization.spectral import spectral_frames
from data_tools.arrays import BoolArray, FloatArray

#: Costs that fall by less than this, nats, have not fallen.
COST_TOL = 1e-6

#: Rounds of choosing rotations and refining.
MAX_SEARCH_ROUNDS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """Poses of a component with the model fitted to them.

    Attributes
    ----------
    model : EdgeModel
    frames : ndarray, shape (N, d, d)
    beliefs : ndarray, shape (N, L)
        Probability of each rotation before the last refinement; rotation 0 is the pose itself.
    alternatives : Hypotheses
    """

    model: EdgeModel
    frames: FloatArray
    beliefs: FloatArray
    alternatives: Hypotheses


def find_poses(graph: PairGraph, fixed: Mapping[int, FloatArray]) -> State:
    """Return the likely poses that the eigenprojection leads to.

    Parameters
    ----------
    graph : PairGraph
        Connected, with at least one pair.
    fixed : mapping of int to ndarray (d, d)
        Frames that may not move; without any, the best connected shape holds the gauge.
    """
    gauge = dict(fixed) or {int(np.argmax(degrees(graph, graph.weights))): np.eye(graph.dim)}
    free, is_fixed = np.ones(graph.num_shapes, dtype=bool), np.zeros(graph.num_shapes, dtype=bool)
    free[list(gauge)], is_fixed[list(fixed)] = False, True
    model = EdgeModel(graph=graph)
    return improve(model, _in_gauge(weighted_start(model), gauge, graph), free, is_fixed)


def weighted_start(model: EdgeModel) -> FloatArray:
    """Return the eigenprojection (N, d, d) of the best candidates, weighted by the evidence of their energies."""
    graph = model.graph
    chance = np.exp(model.log_prior[np.arange(graph.num_edges), graph.best_choice])
    return spectral_frames(graph, graph.chosen(graph.best_choice), chance / model.variances)


def common_costs(states: list[State]) -> FloatArray:
    """Return minus the log-likelihood of the pairs in each state, nats, all at one noise, shape (S,).

    Each state fits its own noise, and a wrong one fits a large noise at which every misfit costs little. States are
    therefore compared at the smallest noise that any of them fits, blurred as where rotations are chosen. What else
    each has fitted (share of outliers, power and odds of energies) stays its own: those are normalised probabilities.
    """
    noise_rad = min(state.model.noise_rad for state in states)
    return np.array([_cost_at(state, noise_rad) for state in states])


def _cost_at(state: State, noise_rad: float) -> float:
    """Return minus the log-likelihood of the pairs in a state at some noise, nats."""
    model = _blurred(replace(state.model, noise_rad=noise_rad))
    own = replace(
        state.alternatives,
        rotations=state.alternatives.rotations[:, :1],
        offered=state.alternatives.offered[:, :1],
    )
    costs = hypothesis_costs(model, aligned_candidates(model.graph, state.frames), own)
    return float((costs[:, 0, 0] + model.log_scale).sum())


def _blurred(model: EdgeModel) -> EdgeModel:
    """Return the model with the noise by which rotations are chosen."""
    several = model.graph.candidates.shape[1] > 1
    return replace(model, noise_rad=PRIORS.label_noise_factors[several] * model.noise_rad)


def improve(model: EdgeModel, frames: FloatArray, free: BoolArray, fixed: BoolArray) -> State:
    """Alternate rotations chosen by beliefs with refinement, from given frames, while the likelihood grows.

    Frames have shape (N, d, d), ``free`` and ``fixed`` (N,). Where no shape is ``fixed`` by hand the one that holds
    the gauge may rotate like all others, so that the answer does not depend on which one holds it.
    """
    model, frames = maximise_likelihood(model, frames, free, estimate=False)
    state = _with_beliefs(model, frames, free, fixed)
    for _ in range(MAX_SEARCH_ROUNDS):
        shapes = np.arange(len(frames))
        chosen = np.argmax(state.beliefs, axis=1)
        moved = state.frames @ state.alternatives.rotations[shapes, chosen]
        model, frames = maximise_likelihood(state.model, moved, free)
        fresh = _with_beliefs(model, frames, free, fixed)
        settled = not chosen.any()
        before, after = common_costs([state, fresh])
        if after >= before - COST_TOL:
            break
        state = fresh
        if settled and not np.argmax(state.beliefs, axis=1).any():
            break
    return state


def _with_beliefs(model: EdgeModel, frames: FloatArray, free: BoolArray, fixed: BoolArray) -> State:
    """Return the state with the beliefs about every shape's rotations."""
    graph = model.graph
    aligned = aligned_candidates(graph, frames)
    alternatives = propose_hypotheses(model, aligned)
    costs = hypothesis_costs(_blurred(model), aligned, alternatives)
    start = np.full(
        (graph.num_shapes, costs.shape[2]), PRIORS.other_hypotheses / (costs.shape[2] - 1)
    )
    start[:, 0] = PRIORS.own_pose
    beliefs = propagate_beliefs(graph.edges, costs, start=start, fixed=~free)
    beliefs[fixed] = np.arange(beliefs.shape[1]) == 0
    return State(model=model, frames=frames, beliefs=beliefs, alternatives=alternatives)


def _in_gauge(frames: FloatArray, gauge: Mapping[int, FloatArray], graph: PairGraph) -> FloatArray:
    """Return the frames in the gauge of the given ones, which get exactly their values."""
    rotation = graph.pattern.project(sum(frames[i].T @ gauge[i] for i in gauge))
    rotated = frames @ rotation
    for i, frame in gauge.items():
        rotated[i] = frame
    return rotated
