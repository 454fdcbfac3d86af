"""The model of whether two groups of shapes are of different kinds, on folders of several kinds and of one kind."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from collalign.confidence import kind_model
from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from collalign.options import AlignOptions
from collalign.stages.kinds.find import least_mismatches, likely_kin
from collalign.stages.kinds.grouping import FEWEST_OF_KIND, Groups
from collalign.stages.kinds.plan import read_all_kinds
from collalign.stages.kinds.pose_free import are_described, kind_descriptors
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.io.objects import list_shapes
from experiments.calibration.scan import Calibration, Finding, constants_of
from experiments.collections.kinds import MIXTURES, draw_kinds
from experiments.collections.scoreboard import SETS, kinds_of
from experiments.provenance import ROOT

#: Draws of the mixtures are others than those that the experiment of kinds is measured on.
SEED = 100
#: Matched pairs are kept here, so that a second fit takes minutes.
STORE = ROOT / ".cache" / "kinds.sqlite"
#: Shapes that each is matched with.
NUM_NEAR = 9
#: Other kinds, the nearest, that each kind of a folder is told apart from.
NUM_RIVALS = 2
#: Share of kinds that no evidence tells apart, as birds and planes.
HOPELESS = 0.02
#: Half the precision of the two weights, relative to the mean log-likelihood.
RIDGE = 0.002
NAMES = ("SPLIT_CONSTANT", "SPLIT_GAP", "SPLIT_ACROSS")


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparisons:
    """Pairs of groups of shapes, of one kind or of two.

    Attributes
    ----------
    evidence : ndarray, shape (n, 3)
        What each of :data:`NAMES` multiplies.
    differ : ndarray of bool, shape (n,)
        Whether the groups are of different kinds.
    """

    evidence: FloatArray
    differ: BoolArray

    def log_odds(self, weights: FloatArray) -> FloatArray:
        """Return the log-odds that the groups are of different kinds, shape (n,)."""
        return np.asarray(self.evidence @ weights)

    def share_right(self, weights: FloatArray) -> float:
        """Return the mean of the shares of groups of one kind, and of two, that are judged rightly; NaN for none."""
        told = self.log_odds(weights) > 0.0
        shares = [np.mean(told[self.differ == is_so] == is_so) for is_so in np.unique(self.differ)]
        return float(np.mean(shares)) if shares else float("nan")


def joined(found: Sequence[Comparisons]) -> Comparisons:
    """Return the comparisons of several folders."""
    return Comparisons(
        evidence=np.concatenate([one.evidence for one in found]),
        differ=np.concatenate([one.differ for one in found]),
    )


def comparisons(log_odds: FloatArray, kinds: IntArray) -> Comparisons:
    """Return the groups that are compared within each kind of a folder, and between neighbouring kinds.

    Within a kind its groups are joined one by one, the nearest first. Those of :data:`FEWEST_OF_KIND` shapes count:
    smaller ones split nothing.

    Parameters
    ----------
    log_odds : ndarray, shape (N, N)
        Of two shapes being of one kind.
    kinds : ndarray of int, shape (N,)
        From 0.
    """
    rows, differ = list[tuple[float, float, float]](), list[bool]()
    for kind in np.unique(kinds):
        own = np.flatnonzero(kinds == kind)
        groups = Groups(log_odds[np.ix_(own, own)])
        while (pair := groups.next_pair(np.inf)) is not None:
            if min(len(groups.members[one]) for one in pair) >= FEWEST_OF_KIND:
                rows.append(_evidence(groups, *np.searchsorted(groups.alive, pair).tolist()))
                differ.append(False)
            groups.join(*pair)
    groups = Groups(log_odds, kinds)
    across = groups.across()
    for one, own_across in enumerate(across):
        rivals = np.argsort(-own_across, kind="stable")[: min(NUM_RIVALS, len(across) - 1)]
        rows += [_evidence(groups, one, other) for other in rivals.tolist()]
        differ += [True] * len(rivals)
    return Comparisons(evidence=np.array(rows).reshape(-1, 3), differ=np.array(differ, dtype=bool))


def _evidence(groups: Groups, one: int, other: int) -> tuple[float, float, float]:
    across = groups.across()
    return 1.0, float(groups.gaps(across)[one, other]), float(across[one, other])


def fit_splits(found: Comparisons) -> FloatArray:
    """Return the weights of :data:`NAMES`: a logistic model; pairs of one kind and of two count alike as a whole."""
    sign = np.where(found.differ, 1.0, -1.0)
    share = 0.5 / np.bincount(found.differ)[found.differ.astype(int)]

    def loss(weights: FloatArray) -> float:
        chance = HOPELESS + (1.0 - 2.0 * HOPELESS) * expit(sign * found.log_odds(weights))
        return float(-share @ np.log(chance) + RIDGE * weights[1:] @ weights[1:])

    start = np.array([getattr(kind_model, name) for name in NAMES])
    return np.asarray(minimize(loss, start).x)


def folder_comparisons(data: Path, collection: str) -> Comparisons:
    """Draw a mixture, or a set of the scoreboard, match its pairs, and compare its groups."""
    kinds: dict[str, int]
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        if collection in MIXTURES:
            rng = np.random.default_rng([SEED, *collection.encode()])
            drawn = draw_kinds(MIXTURES[collection], data, folder, rng)
            kinds = dict(zip(drawn.names, drawn.labels.tolist(), strict=True))
        else:
            of, _, name = collection.partition(": ")
            rng = np.random.default_rng([0, *of.encode(), *name.encode()])
            names = SETS[of][1](name, data, folder, rng).names
            words = kinds_of(name, names)
            kinds = {
                one: sorted({*words}).index(word) for one, word in zip(names, words, strict=True)
            }
        STORE.parent.mkdir(exist_ok=True)
        with Session.open(AlignOptions(), RunOptions(jobs=1, store=STORE), None) as session:
            listing = list_shapes(folder, recursive=collection in MIXTURES)
            session, shapes = read_all_kinds(session, listing, {})
            if not are_described(shapes.samples).all():
                return Comparisons(evidence=np.zeros((0, 3)), differ=np.zeros(0, dtype=bool))
            distances = kind_descriptors(shapes.samples).distances()
            free = kind_model.kin_log_odds(*distances)
            least = least_mismatches(session, shapes, likely_kin(free, NUM_NEAR), "O")
    log_odds = np.minimum(free, 0.0)
    for (i, j), mismatch in least.items():
        shells, general = (distance[i, j] for distance in distances)
        known = kind_model.kin_log_odds(shells, general, np.array(mismatch))
        log_odds[i, j] = log_odds[j, i] = known
    return comparisons(log_odds, np.array([kinds[name] for name in shapes.names]))


def measure_kinds(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Fit the weights on all folders, and without each."""
    every = [folder_comparisons(data, one) for one in (collections[:2] if quick else collections)]
    whole = joined(every)
    fitted = fit_splits(whole)
    code = np.array([getattr(kind_model, name) for name in NAMES])
    told = []
    for at, one in enumerate(every if len(every) > 1 else ()):
        without = fit_splits(joined([*every[:at], *every[at + 1 :]]))
        told.append(Comparisons(evidence=one.evidence * without, differ=one.differ))
    finding = {"now": whole.share_right(code), "best": whole.share_right(fitted)}
    if told:
        finding["left_out"] = joined(told).share_right(np.ones(len(NAMES)))
    return {
        name: Finding(value=weight, **finding)
        for name, weight in zip(NAMES, fitted.tolist(), strict=True)
    }


CALIBRATION = Calibration(
    module=kind_model.__name__,
    constants=constants_of(kind_model, *NAMES),
    measure=measure_kinds,
    collections=(
        *MIXTURES,
        *(f"{of}: {name}" for of, (names, _) in SETS.items() for name in names),
    ),
    score="share of groups that are judged rightly, mean of those of one kind and of two",
)
