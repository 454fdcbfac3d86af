"""Benchmarks of maps between deformable surfaces: their pairs, and what was published on them."""

from __future__ import annotations

import csv
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import combinations, permutations
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from data_tools.arrays import IntArray
from data_tools.embedding.sampling import farthest_points
from data_tools.errors import InputError
from data_tools.io.files import existing_file
from data_tools.surface.shape import Shape
from experiments.datasets import (
    Dataset,
    read_registered_archive,
    read_registered_folder,
    read_shrec07_class,
)
from experiments.generated.bipeds import KINDS, KINDS_APART, biped, template_points

#: Classes of SHREC07 on which the paper shows maps.
SHREC07_CLASSES = ("ant", "teddy", "glasses")
#: Further ones that have landmarks, all of whose pairs are taken.
OTHER_CLASSES = ("armadillo", "bird", "chair", "fish", "human", "plane")
#: Bodies of two kinds, and the landmarks of SHREC07's humans and armadillos that are the same place on both, chosen
#: by hand: hands, elbows, shoulders, knees, two on each foot, nose and crotch. Pairs stand for the two sides.
BODIES = "human and armadillo"
SAME_PLACES = {
    "human": (11, 12, 13, 14, 17, 18, 4, 5, 0, 1, 2, 3, 29, 10),
    "armadillo": (26, 27, 6, 7, 4, 5, 12, 13, 22, 24, 23, 25, 16, 18),
}
MIRRORED_PLACES = (1, 0, 3, 2, 5, 4, 7, 6, 9, 8, 11, 10, 12, 13)
#: Cats and dogs with a dense map between the two, of which so many farthest points of the first cat are landmarks.
ANIMALS, NUM_ANIMAL_POINTS = "cat and dog", 200
#: Generated bodies of several kinds: those that constants may be chosen on, and those kept apart, with people.
BIPEDS, BIPEDS_APART = "generated bipeds", "generated bipeds, kinds kept apart"
#: Bodies of each kind, and half the points of the template at which their maps are evaluated.
NUM_OF_KIND, NUM_HALF_POINTS = 4, 100
#: Sets that are evaluated at landmarks.
LANDMARKED = (*SHREC07_CLASSES, *OTHER_CLASSES, BODIES, ANIMALS, BIPEDS, BIPEDS_APART)
#: Folder of each set.
FOLDERS = {
    BODIES: "shrec07_dev",
    ANIMALS: "tosca_cat_dog",
    "scape": "scape71",
    "tosca": "tosca_centaur6",
    **{name: f"shrec07_dev/{name}" for name in (*SHREC07_CLASSES, *OTHER_CLASSES)},
}
#: Of the choice of pairs.
SEED = 0

Pair = tuple[str, str]


@dataclass(frozen=True, kw_only=True, eq=False)
class MapSet:
    """A benchmark of maps.

    Attributes
    ----------
    name : str
    folder : Path
    data : Dataset
    pairs : tuple of pair of str
        Target and source of each map that the benchmark asks for and the data allow.
    published : dict of str to dict
        Mean error of each pair by published methods, in units of sqrt(area), where they are known.
    """

    name: str
    folder: Path
    data: Dataset
    pairs: tuple[Pair, ...]
    published: dict[str, dict[Pair, float]] = field(default_factory=dict)

    def landmarks(self, name: str) -> IntArray:
        """Return the vertices of a shape's landmarks.

        Raises
        ------
        InputError
            If the set has none.
        """
        if self.data.landmark_vertices is None:
            raise InputError(f"{self.folder}: has no landmarks")
        return self.data.landmark_vertices[self.data.index(name)]

    def on(self, pairs: tuple[Pair, ...]) -> dict[str, tuple[float, ...]]:
        """Return the published errors of these pairs, by method; a method that lacks one of them is left out."""
        return {
            method: tuple(errors[pair] for pair in pairs)
            for method, errors in self.published.items()
            if set(pairs) <= set(errors)
        }


def read_map_set(root: Path, name: str) -> MapSet:
    """Read a benchmark.

    Parameters
    ----------
    root : Path
        Folder of the public collections.
    name : str
        One of ``FOLDERS``, or generated bipeds. SCAPE has the pairs of its query file, the classes of SHREC07 those
        of the published errors; of bodies of two kinds each is matched once; of the others all pairs are taken.
    """
    if name in (BIPEDS, BIPEDS_APART):
        data, pairs = _bipeds(name)
        return MapSet(name=name, folder=root, data=data, pairs=pairs)
    folder = root / FOLDERS[name]
    if name == "scape":
        data = read_registered_archive(folder)
        published = read_published(folder / "bim2011_published_errors.csv", data.names)
        pairs = tuple(
            pair for pair in read_query(folder / "Corr_Scape.query") if set(pair) <= set(data.names)
        )
    elif name in SHREC07_CLASSES:
        data = read_shrec07_class(folder)
        published = read_published(folder.parent / "bim2011_published_errors.csv", data.names)
        pairs = tuple(next(iter(published.values()), {}))
    elif name in (BODIES, ANIMALS):
        data = _bodies(folder) if name == BODIES else _animals(folder)
        published, pairs = {}, _pairs_of_kinds(data)
    else:
        data = read_registered_folder(folder) if name == "tosca" else read_shrec07_class(folder)
        published, pairs = {}, tuple(combinations(data.names, 2))
    return MapSet(name=name, folder=folder, data=data, pairs=pairs, published=published)


def _bodies(folder: Path) -> Dataset:
    """Return the humans and the armadillos as one collection, with the landmarks that both have."""
    kinds = {kind: read_shrec07_class(folder / kind) for kind in SAME_PLACES}
    marks = [
        np.asarray(kinds[kind].landmark_vertices)[:, list(places)]
        for kind, places in SAME_PLACES.items()
    ]
    return Dataset(
        names=tuple(name for kind in kinds.values() for name in kind.names),
        loaders=tuple(load for kind in kinds.values() for load in kind.loaders),
        landmark_vertices=np.concatenate(marks),
        mirror=np.array(MIRRORED_PLACES),
    )


@cache
def _bipeds(name: str) -> tuple[Dataset, tuple[Pair, ...]]:
    """Return generated bodies with the same points of the template on all, and all pairs of two kinds."""
    kinds = KINDS if name == BIPEDS else {"person": KINDS["person"], **KINDS_APART}
    template = template_points()
    places = cKDTree(template)
    left = farthest_points(
        Shape.from_arrays(template[template[:, 1] > 0]), NUM_HALF_POINTS, metric="euclidean"
    )
    half = template[template[:, 1] > 0][left]
    points = places.query(np.concatenate([half, half * [1.0, -1.0, 1.0]]))[1]
    bodies = [
        biped(kinds[kind], np.random.default_rng([SEED, number, at]), f"{kind} {at}")
        for number, kind in enumerate(kinds)
        for at in range(1, NUM_OF_KIND + 1)
    ]
    data = Dataset(
        names=tuple(body.shape.name for body in bodies),
        loaders=tuple(partial(_itself, body.shape) for body in bodies),
        landmark_vertices=np.stack([body.places[points] for body in bodies]),
        mirror=np.roll(np.arange(len(points)), NUM_HALF_POINTS),
    )
    return data, tuple(
        (a, b) for a, b in permutations(data.names, 2) if a.split()[0] != b.split()[0]
    )


def _itself(shape: Shape) -> Shape:
    return shape


def _animals(folder: Path) -> Dataset:
    """Return as many cats as dogs, in this order, with the places on the dogs of points of the cats."""
    cats, dogs, to_dog = (
        dict(np.load(folder / f"{name}.npz")) for name in ("cat", "dog", "cat_to_dog")
    )
    names, loaders = [], []
    for kind in (cats, dogs):
        for at in range(min(len(cats["names"]), len(dogs["names"]))):
            shape = Shape.from_arrays(
                kind["vertices"][at], kind["faces"], name=str(kind["names"][at])
            )
            names.append(shape.name)
            loaders.append(lambda shape=shape: shape)
    points = farthest_points(loaders[0](), NUM_ANIMAL_POINTS, metric="euclidean")
    corners = dogs["faces"][to_dog["triangle"][points]]
    images = corners[np.arange(len(points)), to_dog["barycentric"][points].argmax(axis=1)]
    marks = np.repeat(np.stack([points, images]), len(names) // 2, axis=0)
    return Dataset(names=tuple(names), loaders=tuple(loaders), landmark_vertices=marks)


def kinds_of(maps: MapSet) -> dict[str, tuple[str, ...]]:
    """Return the shapes of each kind of a set of maps between kinds."""
    names, half = maps.data.names, len(maps.data) // 2
    if maps.name in (BODIES, ANIMALS):
        first, second = maps.name.split(" and ")
        return {first: names[:half], second: names[half:]}
    kinds = dict.fromkeys(name.split()[0] for name in names)
    return {kind: tuple(name for name in names if name.split()[0] == kind) for kind in kinds}


def _pairs_of_kinds(data: Dataset) -> tuple[Pair, ...]:
    """Return a pair for each shape of the first half and one of the second, in either direction by turns."""
    half = len(data) // 2
    both = zip(data.names[:half], data.names[half:], strict=True)
    return tuple((a, b) if i % 2 else (b, a) for i, (a, b) in enumerate(both))


def read_query(path: Path) -> list[Pair]:
    """Read the pairs of a query file of the benchmark of Kim, Lipman and Funkhouser (2011).

    Six words make a pair: set, object and pose of the source, then those of the target.
    """
    words = existing_file(path).read_text("utf-8").split()
    try:
        numbers = [(int(words[i + 5]), int(words[i + 2])) for i in range(0, len(words), 6)]
    except (ValueError, IndexError) as error:
        raise InputError(f"{path}: not a list of pairs, six words each ({error})") from error
    return [(f"mesh{target:03d}", f"mesh{source:03d}") for target, source in numbers]


def read_published(path: Path, names: tuple[str, ...]) -> dict[str, dict[Pair, float]]:
    """Read published errors, ``method,source,target,average_geodesic_error`` per line, between the shapes named."""
    found: dict[str, dict[Pair, float]] = {}
    with existing_file(path).open(newline="", encoding="utf-8") as stream:
        for number, row in enumerate(csv.DictReader(stream), start=2):
            try:
                pair, error = (row["target"], row["source"]), float(row["average_geodesic_error"])
            except (KeyError, TypeError, ValueError) as wrong:
                raise InputError(
                    f"{path}: line {number} has no target, source and error"
                ) from wrong
            if set(pair) <= set(names):
                found.setdefault(row["method"], {})[pair] = error
    return found


def some_pairs(pairs: tuple[Pair, ...], num: int, seed: int) -> tuple[Pair, ...]:
    """Return a part of the pairs, drawn by a seed, in their order."""
    chosen = np.sort(np.random.default_rng(seed).permutation(len(pairs))[:num])
    return tuple(pairs[i] for i in chosen)
