"""The model of whether an open surface is a part of a closed one of its kind, on shapes with a part cut off."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from collalign.confidence import kind_model
from data_tools.arrays import BoolArray, FloatArray
from data_tools.embedding.surface_points import spread_points
from data_tools.io.objects import list_shapes
from data_tools.io.shapes import read_shape
from data_tools.options import CleaningOptions
from data_tools.partial_surface import MOST_POINTS, PartialSurface
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from experiments.calibration.scan import Calibration, Finding, constants_of
from experiments.collections.kinds import MIXTURES
from experiments.generated.assembled import CLASSES as ASSEMBLED
from experiments.pairs.incomplete import without_share
from pairwise.partial_match import match_partial

SEED = 3
#: Shapes of each kind, and those of them that are cut; each of these is matched with the other kinds' shapes as well.
NUM_SHAPES, NUM_CUT, NUM_OTHERS = 3, 2, 5
#: Shares of the vertices that are cut off.
CUTS = (0.15, 0.5)
#: Half the precision of the weight, relative to the mean log-likelihood.
RIDGE = 0.002
NAMES = ("PART_CONSTANT", "PART_ENERGY")
#: The kinds of the mixtures, by mixture and name, without those that are assembled of a few triangles.
KINDS = {
    f"{mixture}: {name}": draw
    for mixture in ("CAPOD", "SHREC07", "skulls and molars", "generated")
    for name, draw in MIXTURES[mixture].items()
    if name not in ASSEMBLED
}


@dataclass(frozen=True, kw_only=True, eq=False)
class PartPairs:
    """Cut shapes of one kind beside whole ones.

    Attributes
    ----------
    energies : ndarray, shape (n,)
        Least of each pair.
    are_kin : ndarray of bool, shape (n,)
        Whether the whole shape is of the same kind.
    """

    energies: FloatArray
    are_kin: BoolArray

    def log_odds(self, weights: FloatArray) -> FloatArray:
        """Return the log-odds that the pairs are of one kind, shape (n,)."""
        return np.asarray(weights[0] + weights[1] * np.log(self.energies))

    def share_right(self, weights: FloatArray) -> float:
        """Return the mean of the shares of kin, and of others, that are judged rightly."""
        told = self.log_odds(weights) > 0.0
        shares = [
            np.mean(told[self.are_kin == are_so] == are_so) for are_so in np.unique(self.are_kin)
        ]
        return float(np.mean(shares))


def joined(found: Sequence[PartPairs]) -> PartPairs:
    """Return the pairs of several kinds."""
    return PartPairs(
        energies=np.concatenate([one.energies for one in found]),
        are_kin=np.concatenate([one.are_kin for one in found]),
    )


def fit_parts(found: PartPairs) -> FloatArray:
    """Return the weights of :data:`NAMES`: a logistic model; kin and others count alike as a whole."""
    sign = np.where(found.are_kin, 1.0, -1.0)
    share = 0.5 / np.bincount(found.are_kin)[found.are_kin.astype(int)]

    def loss(weights: FloatArray) -> float:
        likelihood = share @ np.log(expit(sign * found.log_odds(weights)))
        return float(RIDGE * weights[1] ** 2 - likelihood)

    return np.asarray(minimize(loss, np.zeros(2)).x)


def drawn_shapes(data: Path, kind: str) -> list[Shape]:
    """Return some shapes of a kind in random poses."""
    rng = np.random.default_rng([SEED, *kind.encode()])
    with tempfile.TemporaryDirectory() as text:
        KINDS[kind](data, Path(text), rng)
        listing = list_shapes(text)
        named = zip(listing.files[:NUM_SHAPES], listing.names, strict=False)
        return [read_shape(file, CleaningOptions(), name=name) for file, name in named]


def part_pairs(
    cut: Sequence[PartialSurface], kin: Sequence[PartialSurface], others: Sequence[PartialSurface]
) -> PartPairs:
    """Match cut shapes with whole ones: each with all kin but that which it was cut from, and with others.

    Cut shapes come in the order of those that they were cut from.
    """
    found = [
        (match_partial(whole, part), whole in kin)
        for at, part in enumerate(cut)
        for whole in (*kin[:at], *kin[at + 1 :], *others)
    ]
    known = [(poses[0].energy, is_kin) for poses, is_kin in found if poses]
    return PartPairs(
        energies=np.array([energy for energy, _ in known]),
        are_kin=np.array([is_kin for _, is_kin in known], dtype=bool),
    )


def measure_parts(data: Path, collections: Sequence[str], quick: bool) -> Mapping[str, Finding]:
    """Fit the weights on all kinds, and without each."""
    kinds = collections[:3] if quick else collections
    shapes = {kind: drawn_shapes(data, kind) for kind in kinds}
    wholes = {
        kind: [spread_points(one, MOST_POINTS) for one in own] for kind, own in shapes.items()
    }
    every = []
    for kind, own in shapes.items():
        rng = np.random.default_rng([SEED + 1, *kind.encode()])
        cut = [
            spread_points(
                without_share(one, random_rotation(rng)[0], rng.uniform(*CUTS)), MOST_POINTS
            )
            for one in own[:NUM_CUT]
        ]
        strangers = [one for other in kinds if other != kind for one in wholes[other]]
        chosen = rng.choice(len(strangers), min(NUM_OTHERS, len(strangers)), replace=False)
        every.append(part_pairs(cut, wholes[kind], [strangers[n] for n in chosen.tolist()]))
    whole = joined(every)
    fitted = fit_parts(whole)
    code = np.array([getattr(kind_model, name) for name in NAMES])
    left_out = [
        one.share_right(fit_parts(joined([*every[:at], *every[at + 1 :]])))
        for at, one in enumerate(every if len(every) > 1 else ())
    ]
    return {
        name: Finding(
            value=weight,
            now=whole.share_right(code),
            best=whole.share_right(fitted),
            left_out=float(np.mean(left_out)) if left_out else float("nan"),
        )
        for name, weight in zip(NAMES, fitted.tolist(), strict=True)
    }


CALIBRATION = Calibration(
    module=kind_model.__name__,
    constants=constants_of(kind_model, *NAMES),
    measure=measure_parts,
    collections=(*KINDS,),
    score="share of pairs that are judged rightly, mean of kin and of others",
)
