"""The probabilistic model of a pair: which candidate is right, how noisy it is, and how often none is right.

A pair's likelihood at frames ``P`` is ``sum_k (1 - p_out) pi_k exp(-r_k^2 / (4 s_e^2)) + p_out u_e``, where ``r_k``
is the Frobenius distance of candidate k to ``P_i P_j^T`` (``r^2 / 2`` is the squared angle, for small angles),
``s_e`` the noise per axis and ``u_e`` the ratio of the uniform density on the group to the peak of the normal one.
Everything in it is estimated from the pairs themselves: noise, share of outliers, what energies say of candidates.
Its priors and limits are in :class:`Priors`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from collalign.synchronization.frames import relative
from collalign.synchronization.graph import PairGraph
from data_tools.arrays import FloatArray, IntArray


class Priors(NamedTuple):
    """What holds where pairs are too few to say, and how far beliefs are believed.

    Set on the planted graphs of ``python -m experiments synchronization``, on other seeds than its own (of the shapes
    stated at .95 at least 99 % were to be right). No public collection was looked at for that;
    ``python -m experiments calibrate model`` measures on three of them what the first priors stand for.
    """

    noise_rad: float = 0.1
    """Prior noise per axis, radians, ..."""
    noise_pairs: float = 3.0
    """... and the number of pairs that it counts for."""
    noise_range_rad: tuple[float, float] = (1e-5, 0.35)
    """Noise per axis is kept between these."""
    outliers: float = 0.1
    """Prior share of pairs without any right candidate, ..."""
    outlier_pairs: float = 4.0
    """... and the number of pairs that it counts for."""
    outlier_range: tuple[float, float] = (1e-3, 0.9)
    """That share is kept between these."""
    log_odds: float = 1.5
    """Prior log-odds of a pair's lowest energy against another candidate of median energy, ..."""
    precision: float = 1.0
    """... and the precision of either half of it."""
    most_log_odds: tuple[float, float] = (6.0, 50.0)
    """Largest log-odds of the best candidate, and per unit of log-energy."""
    energy_factor: float = 100.0
    """Energies of pairs count within this factor of their median, either way."""
    spent_share: float = 0.8
    """Most of the right candidates that the frames may use up, when degrees of freedom are counted."""
    label_noise_factors: tuple[float, float] = (2.0, 3.0)
    """Noise is this many times larger where rotations are chosen, with one candidate per pair and with several:
    frames fitted to one choice of candidates fit their noise too, which would count as evidence for the choice."""
    own_pose: float = 0.9
    """How probable a shape's own pose is where beliefs start, ..."""
    other_hypotheses: float = 0.1
    """... and all its other rotations together."""
    explained_share: float = 0.8
    """A shape of which this share of the pairs is explained has no rotations but the common ones."""
    flipped: float = 0.1
    """How many pairs, of one more, are taken to be wrong by each common rotation where none is seen."""
    rare_flip: float = 0.003
    """Common rotations by which fewer pairs than this are wrong are left out of their costs."""
    enough_signal: float = 1.5
    """A signal of the graph below this makes beliefs overconfident; confidences shrink, to half without a signal."""
    enough_pairs: float = 2.6
    """The same for the evidence of a shape's own pairs."""


#: The numbers in use.
PRIORS = Priors()


#: Pairs that state a constraint weigh this many times the heaviest other pair; the least weight of a pair.
FIXED_WEIGHT, LEAST_WEIGHT = 1e3, 1e-9

#: The power of the energy that the noise follows: its limits, and the spread of log-energies and the number of right
#: pairs from which on it is estimated.
POWER_RANGE, LEAST_SPREAD, FEWEST_RIGHT = (0.0, 2.0), 0.1, 10.0

#: Newton steps to what energies say of candidates.
MAX_NEWTON_STEPS = 10


def group_volume(dim: int) -> float:
    """Return the volume of SO(d) in the metric ``|log R|_F^2 / 2``: the product of the spheres S^1 ... S^(d-1)."""
    sizes = np.arange(2, dim + 1)
    return float(np.prod(2.0 * np.pi ** (sizes / 2.0) / scipy.special.gamma(sizes / 2.0)))


@dataclass(frozen=True, kw_only=True, eq=False)
class EdgeModel:
    """Parameters of the likelihood of a graph's pairs.

    Attributes
    ----------
    graph : PairGraph
    noise_rad : float
        Standard deviation per axis of a right candidate in a pair of median energy.
    noise_power : float
        The noise grows with the pair's lowest energy to this power.
    outliers : float
        Share of pairs without a right candidate.
    best_log_odds : float
        How much more probable the candidate of lowest energy is than another one.
    energy_slope : float
        Log-odds lost per unit of ``log(energy / lowest energy)``, over its median.
    """

    graph: PairGraph
    noise_rad: float = PRIORS.noise_rad
    noise_power: float = 0.0
    outliers: float = PRIORS.outliers
    best_log_odds: float = PRIORS.log_odds / 2
    energy_slope: float = PRIORS.log_odds / 2

    @cached_property
    def log_prior(self) -> FloatArray:
        """``log pi_k`` of each candidate, shape (E, m); minus infinity where it is not present."""
        if self.graph.log_odds is not None:
            score = np.where(self.graph.present, self.graph.log_odds, -np.inf)
            score = score - score.max(axis=1, keepdims=True)
            return np.asarray(score - np.log(np.exp(score).sum(axis=1, keepdims=True)))
        features = candidate_features(self.graph)
        score = -self.best_log_odds * features[..., 0] - self.energy_slope * features[..., 1]
        score = np.where(self.graph.present, score, -np.inf)
        score -= score.max(axis=1, keepdims=True, initial=-1e300)
        return score - np.log(np.exp(score).sum(axis=1, keepdims=True))

    @cached_property
    def variances(self) -> FloatArray:
        """``s_e^2``, shape (E,), radians squared."""
        scale = relative_energies(self.graph) ** (2.0 * self.noise_power)
        return self.noise_rad**2 * scale / relative_weights(self.graph)

    @cached_property
    def log_scale(self) -> FloatArray:
        """Minus the log of the peak of the normal density, shape (E,): what :meth:`costs` leaves out."""
        dof = self.graph.dim * (self.graph.dim - 1) / 2.0
        return np.asarray(dof / 2.0 * np.log(2.0 * np.pi * self.variances))

    @cached_property
    def log_uniform(self) -> FloatArray:
        """``log (p_out u_e)``, shape (E,); minus infinity for fixed pairs."""
        density = np.minimum(self.log_scale - np.log(self._volume), -1.0)
        return np.where(self.graph.fixed, -np.inf, np.log(self.outliers) + density)

    @property
    def _volume(self) -> float:
        """Volume of the group: reflections double it."""
        return group_volume(self.graph.dim) * (1.0 if self.graph.pattern.special_blocks else 2.0)

    def log_terms(self, squared: FloatArray) -> FloatArray:
        """Return the log of each candidate's term for squared distances (E, m, ...)."""
        tail = (1,) * (squared.ndim - 2)
        scale = 4.0 * self.variances.reshape(-1, 1, *tail)
        return (
            np.log1p(-self.outliers)
            + self.log_prior.reshape(*self.log_prior.shape, *tail)
            - squared / scale
        )

    def costs(self, squared: FloatArray) -> FloatArray:
        """Return minus the log-likelihood of each pair for squared distances (E, m, ...), shape (E, ...).

        Relative to the peak of the normal density, ``-log_scale``.
        """
        terms = self.log_terms(squared)
        floor = self.log_uniform.reshape(-1, *(1,) * (squared.ndim - 2))
        top = np.maximum(terms.max(axis=1), floor)
        return -top - np.log(np.exp(terms - top[:, None]).sum(axis=1) + np.exp(floor - top))

    def responsibilities(self, squared: FloatArray) -> FloatArray:
        """Return the probability that each candidate is the right one, shape (E, m), given squared distances."""
        return np.exp(self.log_terms(squared) + self.costs(squared)[:, None])

    def updated(self, squared: FloatArray) -> EdgeModel:
        """Return the model re-estimated at squared distances (E, m): one expectation-maximisation step."""
        share = self.responsibilities(squared)
        free = ~self.graph.fixed
        right = share.sum(axis=1) * free
        outliers = (free.sum() - right.sum() + PRIORS.outliers * PRIORS.outlier_pairs) / (
            free.sum() + PRIORS.outlier_pairs
        )
        power = _fitted_power(self, share, squared)
        noise = _fitted_noise(replace(self, noise_power=power), share, squared)
        best, slope = _fitted_candidates(self, share)
        return EdgeModel(
            graph=self.graph,
            noise_rad=noise,
            noise_power=power,
            outliers=float(np.clip(outliers, *PRIORS.outlier_range)),
            best_log_odds=best,
            energy_slope=slope,
        )


def squared_distances(graph: PairGraph, frames: FloatArray) -> FloatArray:
    """Return ``|R_i_j - P_i P_j^T|_F^2`` of every candidate, shape (E, m)."""
    size = graph.dim**2
    expected = relative(frames, graph.edges).reshape(graph.num_edges, size, 1)
    flat = graph.candidates.reshape(graph.num_edges, graph.candidates.shape[1], size)
    inner = (flat @ expected)[:, :, 0]
    return np.maximum(2.0 * graph.dim - 2.0 * inner, 0.0)


def candidate_features(graph: PairGraph) -> FloatArray:
    """Return for each candidate whether it is not the best, and its log-energy above the best, shape (E, m, 2).

    The second is in units of its median over the collection.
    """
    features = np.zeros((*graph.present.shape, 2))
    if graph.energies is None:
        return features
    features[..., 0] = np.arange(graph.present.shape[1]) != graph.best_choice[:, None]
    energies = np.where(graph.present, graph.energies, np.nan)
    floor = max(1e-12 * float(np.nanmax(energies, initial=0.0)), np.finfo(float).tiny)
    lowest = np.nanmin(energies, axis=1, keepdims=True)
    above = np.log(np.maximum(energies, floor) / np.maximum(lowest, floor))
    others = graph.present & (features[..., 0] > 0)
    typical = float(np.median(above[others])) if others.any() else 0.0
    if typical > 0.0:
        features[..., 1] = np.where(graph.present, above / typical, 0.0)
    return features


def relative_energies(graph: PairGraph) -> FloatArray:
    """Return each pair's lowest energy over their median, shape (E,), within a factor; else ones."""
    if graph.energies is None or not (~graph.fixed).any():
        return np.ones(graph.num_edges)
    lowest = np.where(graph.present, graph.energies, np.inf).min(axis=1)
    middle = float(np.median(lowest[~graph.fixed]))
    if middle <= 0.0:
        return np.ones(graph.num_edges)
    return np.where(
        graph.fixed,
        1.0 / PRIORS.energy_factor,
        np.clip(lowest / middle, 1.0 / PRIORS.energy_factor, PRIORS.energy_factor),
    )


def relative_weights(graph: PairGraph) -> FloatArray:
    """Return the caller's weights over their median, shape (E,); fixed pairs weigh most, by ``FIXED_WEIGHT``."""
    used = graph.weights[(graph.weights > 0) & ~graph.fixed]
    if not len(used):
        return np.ones(graph.num_edges)
    scaled = np.maximum(graph.weights / np.median(used), LEAST_WEIGHT)
    return np.where(graph.fixed, FIXED_WEIGHT * scaled[~graph.fixed].max(initial=1.0), scaled)


def _fitted_noise(model: EdgeModel, share: FloatArray, squared: FloatArray) -> float:
    """Return the noise per axis, degrees of freedom spent on the frames discounted, shrunk to the prior."""
    graph = model.graph
    dof = graph.dim * (graph.dim - 1) / 2.0
    share = share * ~graph.fixed[:, None]
    scaled = squared / 2.0 / (model.variances / model.noise_rad**2)[:, None]
    spent = min(graph.num_shapes - 1, PRIORS.spent_share * float(share.sum()))
    total = float((share * scaled).sum()) + PRIORS.noise_pairs * dof * PRIORS.noise_rad**2
    count = dof * (float(share.sum()) - spent) + PRIORS.noise_pairs * dof
    return float(np.clip(np.sqrt(total / count), *PRIORS.noise_range_rad))


def _fitted_power(model: EdgeModel, share: FloatArray, squared: FloatArray) -> float:
    """Return the power of the energy that the noise follows: regression of log distance on log energy."""
    energy = np.log(relative_energies(model.graph))
    right = share.sum(axis=1) * ~model.graph.fixed
    if np.ptp(energy) < LEAST_SPREAD or right.sum() < FEWEST_RIGHT:
        return 0.0
    distance = (share * squared).sum(axis=1) / np.maximum(right, 1e-12)
    height = 0.5 * np.log(np.maximum(distance, 1e-8))
    centre, level = np.average(energy, weights=right), np.average(height, weights=right)
    spread = float(right @ (energy - centre) ** 2)
    slope = float(right @ ((energy - centre) * (height - level))) / (spread + 1.0)
    return float(np.clip(slope, *POWER_RANGE))


def _fitted_candidates(model: EdgeModel, share: FloatArray) -> tuple[float, float]:
    """Return what energies say about candidates: conditional logit by Newton, shrunk to the prior."""
    features = candidate_features(model.graph)
    if model.graph.log_odds is not None or not features.any():
        return model.best_log_odds, model.energy_slope
    used = (model.graph.present.sum(axis=1) > 1) & ~model.graph.fixed
    features, counts = features[used], share[used]
    totals = counts.sum(axis=1)
    value = np.array([model.best_log_odds, model.energy_slope])
    prior, precision = np.array([PRIORS.log_odds / 2, PRIORS.log_odds / 2]), PRIORS.precision
    for _ in range(MAX_NEWTON_STEPS):
        score = np.where(model.graph.present[used], -(features @ value), -np.inf)
        chance = np.exp(score - score.max(axis=1, keepdims=True))
        chance /= chance.sum(axis=1, keepdims=True)
        mean = np.einsum("ek,ekf->ef", chance, features)
        gradient = (
            totals @ mean - np.einsum("ek,ekf->f", counts, features) - precision * (value - prior)
        )
        centred = features - mean[:, None]
        hessian = np.einsum(
            "e,ek,ekf,ekg->fg", totals, chance, centred, centred
        ) + precision * np.eye(2)
        value = np.clip(value + np.linalg.solve(hessian, gradient), 0.0, PRIORS.most_log_odds)
    return float(value[0]), float(value[1])


def best_candidates(squared: FloatArray, model: EdgeModel) -> IntArray:
    """Return the most probable candidate of each pair, shape (E,)."""
    return np.argmax(model.log_terms(squared), axis=1)
