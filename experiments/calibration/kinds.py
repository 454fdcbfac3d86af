"""The weights of the evidence that two shapes are of one kind: a conditional logit of which shapes are kin."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

from collalign.confidence import kind_model
from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from collalign.options import AlignOptions
from collalign.stages.choose_pairs import all_pairs
from collalign.stages.kinds.find import least_of_pairs
from collalign.stages.kinds.grouping import group_shapes
from collalign.stages.kinds.plan import read_all_kinds
from collalign.stages.kinds.pose_free import kind_descriptors
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.errors import InputError
from data_tools.io.objects import list_shapes
from experiments.calibration.scan import Calibration, Finding, constants_of
from experiments.collections.kinds import MIXTURES, draw_kinds, purity

#: Half the precision of the standardised weights, beside the mean log-likelihood of a class.
RIDGE = 0.003
#: Draws of the mixtures are others than those that the experiment of kinds is measured on.
SEED = 100
#: The evidence of matched pairs, and of pairs before they are matched.
MATCHED = ("MISMATCH", "ENERGY", "SHELLS", "INVARIANTS")
FREE = ("FREE_SHELLS", "FREE_DESCRIPTOR")


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """What tells the kinds of one mixture apart.

    Attributes
    ----------
    kinds : ndarray of str, shape (N,)
        Of each shape, with the name of the mixture.
    values : dict of str to ndarray, shape (N, N)
        What each weight of :data:`MATCHED` and :data:`FREE` multiplies.
    """

    kinds: np.ndarray
    values: dict[str, FloatArray]

    def some(self, chosen: BoolArray) -> Evidence:
        """Return that of some of the shapes."""
        table = np.ix_(chosen, chosen)
        values = {name: of[table] for name, of in self.values.items()}
        return Evidence(kinds=self.kinds[chosen], values=values)

    def table(self, names: Sequence[str]) -> FloatArray:
        """Return the evidence of some weights, shape (N, N, n)."""
        return np.stack([self.values[name] for name in names], axis=-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Weights:
    """Log-odds that pairs are of one kind: a constant, and the weights of the evidence."""

    names: tuple[str, ...]
    constant: float
    weights: FloatArray

    def log_odds(self, evidence: Evidence) -> FloatArray:
        """Return the log-odds of all pairs, shape (N, N)."""
        return np.asarray(self.constant + evidence.table(self.names) @ self.weights)


def evidence_of(data: Path, mixture: str, quick: bool) -> Evidence:
    """Match all pairs of a draw of a mixture; with ``quick`` of its first three kinds."""
    kinds = MIXTURES[mixture]
    if quick:
        kinds = dict([*kinds.items()][:3])
    rng = np.random.default_rng([SEED, *mixture.encode()])
    with tempfile.TemporaryDirectory() as text:
        drawn = draw_kinds(kinds, data, Path(text), rng)
        with Session.open(AlignOptions(group="SO"), RunOptions(jobs=1), None) as session:
            session, shapes = read_all_kinds(session, list_shapes(text, recursive=True), {})
            every = [(i, j) for i, j in all_pairs(len(shapes.names)).tolist()]
            least = least_of_pairs(session, shapes, every, "SO")
    descriptors = kind_descriptors(shapes.samples)
    if descriptors is None:
        raise InputError(f"{mixture}: some shapes have too few points")
    of_name = dict(zip(drawn.names, drawn.labels.tolist(), strict=True))
    num = len(shapes.names)
    mismatches, energies = np.ones((num, num)), np.ones((num, num))
    for (i, j), (mismatch, energy) in least.items():
        mismatches[i, j] = mismatches[j, i] = mismatch
        energies[i, j] = energies[j, i] = energy
    shells, general, invariants = (kind_model.log_of(of) for of in descriptors.distances())
    return Evidence(
        kinds=np.array([f"{mixture}: {of_name[name]}" for name in shapes.names]),
        values={
            "MISMATCH": mismatches,
            "ENERGY": kind_model.log_of(energies),
            "SHELLS": shells,
            "INVARIANTS": invariants,
            "FREE_SHELLS": shells,
            "FREE_DESCRIPTOR": general,
        },
    )


def fit_weights(drawn: Sequence[Evidence], names: Sequence[str]) -> Weights:
    """Return the weights under which the kin of each shape is likeliest among all others; kinds count alike.

    The constant and the unit are those by which the nearest kin and the nearest stranger of shapes are told apart.
    """
    tables = [one.table(names) for one in drawn]
    every = np.concatenate([table[~np.eye(len(table), dtype=bool)] for table in tables])
    mean, size = every.mean(axis=0), every.std(axis=0)
    same = [one.kinds[:, None] == one.kinds for one in drawn]
    share = [1.0 / of.sum(axis=1) for of in same]
    able = [of.sum(axis=1) > 1 for of in same]
    total = sum(float((of * ok).sum()) for of, ok in zip(share, able, strict=True))

    def scores(weights: FloatArray) -> list[FloatArray]:
        found = [-((table - mean) / size) @ weights for table in tables]
        for one in found:
            np.fill_diagonal(one, -np.inf)
        return found

    def loss(weights: FloatArray) -> float:
        lost = RIDGE * float(weights @ weights)
        for score, kin, part, ok in zip(scores(weights), same, share, able, strict=True):
            among = logsumexp(np.where(kin, score, -np.inf)[ok], axis=1)
            lost += float(part[ok] @ (logsumexp(score[ok], axis=1) - among)) / total
        return lost

    bounds = [(0.0, None)] * len(names)
    fitted = minimize(loss, np.ones(len(names)), method="L-BFGS-B", bounds=bounds).x
    nearest = [
        [np.where(of, score, -np.inf)[ok].max(axis=1) for of in (kin, ~kin)]
        for score, kin, ok in zip(scores(fitted), same, able, strict=True)
    ]
    kin, strangers = (np.concatenate([both[k] for both in nearest]) for k in (0, 1))
    part = np.concatenate([of[ok] for of, ok in zip(share, able, strict=True)]) / total

    def unlike(line: FloatArray) -> float:
        of_kin, of_strangers = line[0] + line[1] * kin, line[0] + line[1] * strangers
        lost = part @ (np.logaddexp(0.0, -of_kin) + np.logaddexp(0.0, of_strangers))
        return float(lost) + RIDGE * float(line @ line)

    constant, unit = minimize(unlike, np.array([0.0, 1.0])).x
    weights = -unit * fitted / size
    return Weights(names=tuple(names), constant=float(constant - weights @ mean), weights=weights)


def left_out(drawn: Sequence[Evidence], names: Sequence[str]) -> list[FloatArray]:
    """Return the log-odds of each mixture, of every pair by the mean of two fits that lack the kind of either."""
    found = []
    for one in drawn:
        odds = np.zeros((len(one.kinds), len(one.kinds)))
        for kind in np.unique(one.kinds):
            without = fit_weights([other.some(other.kinds != kind) for other in drawn], names)
            own = without.log_odds(one) / 2.0
            odds[one.kinds == kind] += own[one.kinds == kind]
            odds[:, one.kinds == kind] += own[:, one.kinds == kind]
        found.append(odds)
    return found


def mean_purity(drawn: Sequence[Evidence], log_odds: Sequence[FloatArray]) -> float:
    """Return the mean purity of the kinds that are found in each mixture where all pairs are matched."""
    shares = []
    for one, odds in zip(drawn, log_odds, strict=True):
        found: IntArray = group_shapes(odds, kind_model.LEAST_GAP).labels
        shares.append(purity(np.unique(one.kinds, return_inverse=True)[1], found))
    return float(np.mean(shares))


def measure_kinds(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Fit the weights, on all mixtures and without each kind."""
    drawn = [evidence_of(data, mixture, quick) for mixture in collections]
    findings = {}
    for constant, names in (("CONSTANT", MATCHED), ("FREE_CONSTANT", FREE)):
        fitted = fit_weights(drawn, names)
        code = Weights(
            names=names,
            constant=getattr(kind_model, constant),
            weights=np.array([getattr(kind_model, name) for name in names]),
        )
        scores = Finding(
            value=fitted.constant,
            now=mean_purity(drawn, [code.log_odds(one) for one in drawn]),
            best=mean_purity(drawn, [fitted.log_odds(one) for one in drawn]),
            left_out=mean_purity(drawn, left_out(drawn, names)),
        )
        findings[constant] = scores
        for name, weight in zip(names, fitted.weights.tolist(), strict=True):
            findings[name] = replace(scores, value=weight)
    return findings


CALIBRATION = Calibration(
    module=kind_model.__name__,
    constants=constants_of(kind_model, "CONSTANT", *MATCHED, "FREE_CONSTANT", *FREE),
    measure=measure_kinds,
    collections=("SHREC07", "CAPOD", "seats and guns", "skulls and molars", "generated"),
    score="purity of the kinds found where all pairs are matched, all weights together",
)
