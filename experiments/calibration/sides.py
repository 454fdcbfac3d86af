"""The thresholds by which a folder mixes left and right specimens, on subsets of collections that do or do not.

A mirror image of a shape swaps the energies of its pairs and negates its scores, so molars of both sides also make
subsets of one side, and of one side but for one specimen. Of the other collections no member is another's mirror
image.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from collalign.confidence import side_model as sides
from collalign.options import AlignOptions
from collalign.stages import mixed_sides
from collalign.stages.choose_pairs import all_pairs, describe_shapes
from collalign.stages.shape_stage import measure_surfaces
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.embedding.chirality import SurfaceChirality, chirality_scores, place_shares
from experiments.calibration.matched import matched
from experiments.calibration.scan import Calibration, Constant, Finding, constants_of, patched, scan
from experiments.collections.landmarked import read_dataset

#: Shapes of each collection, and random subsets of them.
NUM_SHAPES, NUM_SUBSETS = 24, 60
NUM_QUICK_SHAPES, NUM_QUICK_SUBSETS = 7, 2
#: Mirroring shapes that are no mirror images counts as so many misses of some that are.
FALSE_ALARM = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Subset:
    """Some shapes, the energies of their pairs by look, the scores of their surfaces, and which are mirrored.

    Energies and scores are those with the ``swapped`` shapes mirrored; the surfaces are as they are.
    """

    descriptors: FloatArray
    energies: dict[tuple[int, int], FloatArray]
    scores: FloatArray
    mirrored: BoolArray
    surfaces: tuple[SurfaceChirality, ...]
    swapped: BoolArray

    @cached_property
    def place_shares(self) -> FloatArray:
        """How much of what tells each surface's side lies in one place."""
        return place_shares(self.surfaces, sides.surface_sides(self.scores).mirrored ^ self.swapped)

    def verdict(self) -> float:
        """Return 1 where the sides are judged rightly, 0 where they are missed, less where there are none.

        One half where the sides are there, but in doubt; of one side, the share not in doubt.
        """
        num = len(self.mirrored)

        def energies_of(
            edges: IntArray, num_poses: int, max_steps: int
        ) -> tuple[list[tuple[int, int]], FloatArray]:
            of_pairs = self.energies[num_poses, max_steps]
            return [(int(i), int(j)) for i, j in edges], of_pairs[edges[:, 0], edges[:, 1]]

        found, compared, energies = mixed_sides.staged_sides(
            all_pairs(num), self.descriptors, energies_of
        )
        by_surfaces = sides.surface_sides(self.scores, found.mirrored)
        alone = sides.surface_sides(self.scores)
        are_both = self.mirrored.any() and not self.mirrored.all()
        if alone.are_clear and sides.lie_in_one_place(self.place_shares):
            return 0.5 if are_both else 0.0
        if alone.are_clear or sides.are_mixed(found, by_surfaces):
            return 1.0 if are_both else -FALSE_ALARM
        one_kind = sides.are_one_kind(alone.mirrored, compared, energies)
        doubted = sides.undecided_sides(found, by_surfaces, alone, one_kind=one_kind)
        if not are_both:
            return float(1.0 - doubted.mean())
        return 0.5 * bool(doubted[self.mirrored].all() or doubted[~self.mirrored].all())


def draw_subsets(data: Path, collection: str, quick: bool) -> list[Subset]:
    """Match the pairs of one collection and draw subsets of its shapes."""
    num = NUM_QUICK_SHAPES if quick else NUM_SHAPES
    with matched(data, collection, num, AlignOptions(group="O")) as found:
        samples, num = found.shapes.samples, len(found.shapes.names)
        descriptors = describe_shapes(found.shapes)
        surfaces = measure_surfaces(found.session, found.shapes)
        scores = chirality_scores(surfaces)
        energies = {look[1:]: np.full((num, num, 2), np.nan) for look in mixed_sides.LOOKS}
        for look, of_pairs in energies.items():
            for pair in found.pairs:
                i, j = pair.target, pair.source
                of_pairs[i, j] = of_pairs[j, i] = mixed_sides.chirality_energies(
                    pair, samples[i], samples[j], *look
                )
        dataset = read_dataset(collection, data)
        mirrored = np.zeros(num, dtype=bool)
        if dataset.chirality is not None:
            mirrored = np.array(
                [dataset.chirality[dataset.index(name)] < 0 for name in found.shapes.names]
            )
    rng = np.random.default_rng(1)
    subsets = []
    for _ in range(NUM_QUICK_SUBSETS if quick else NUM_SUBSETS):
        some = np.sort(rng.permutation(num)[: rng.integers(sides.MIN_SHAPES_FOR_SIDES, num + 1)])
        part = {look: of_pairs[np.ix_(some, some)] for look, of_pairs in energies.items()}
        for wanted in _wanted(mirrored[some], rng) if mirrored.any() else [mirrored[some]]:
            swapped = wanted != mirrored[some]
            between = (swapped[:, None] != swapped)[..., None]
            rotated = {
                look: np.where(between, of_pairs[..., ::-1], of_pairs)
                for look, of_pairs in part.items()
            }
            seen = np.where(between[..., 0], -1.0, 1.0) * scores[np.ix_(some, some)]
            subsets.append(
                Subset(
                    descriptors=descriptors[some],
                    energies=rotated,
                    scores=seen,
                    mirrored=wanted,
                    surfaces=tuple(surfaces[i] for i in some),
                    swapped=swapped,
                )
            )
    return subsets


def _wanted(mirrored: BoolArray, rng: np.random.Generator) -> Iterator[BoolArray]:
    """Both sides as they are, one side, and one side but for one specimen."""
    yield mirrored
    yield np.zeros_like(mirrored)
    yield np.arange(len(mirrored)) == rng.integers(len(mirrored))


def measure_sides(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Judge the subsets with other thresholds."""
    drawn = {collection: draw_subsets(data, collection, quick) for collection in collections}

    def score(collection: str, changed: Mapping[str, Constant]) -> float:
        with patched(sides, changed):
            return float(np.mean([subset.verdict() for subset in drawn[collection]]))

    return scan(CALIBRATION.constants, collections, score, quick=quick)


CALIBRATION = Calibration(
    module=sides.__name__,
    constants=constants_of(
        sides,
        "LEAST_CONFIRMED",
        "MOST_CONTRADICTED",
        "LEAST_OPEN",
        "LEAST_OPEN_ALONE",
        "LEAST_ALONE",
        "LARGEST_PLACE",
        "LIKELY_BETWEEN",
        "LIKELY_BALANCE",
        "LEAST_OBVIOUS",
    ),
    measure=measure_sides,
    collections=("teeth", "chair", "glasses", "ant", "teddy", "human"),
    score=(
        f"share of right verdicts on subsets; mirroring without need counts as {FALSE_ALARM:.0f} misses, "
        "doubt in place of mirroring as half a verdict"
    ),
)
