"""Non-rigid matching on public collections by the protocol of Kim, Lipman and Funkhouser (2011).

python -m tests.benchmarks.bench_nonrigid scape --limit 10
python -m tests.benchmarks.bench_nonrigid tosca --variant remeshed
python -m tests.benchmarks.bench_nonrigid ant --strategy paper
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import fast_simplification
import numpy as np
from scipy.spatial import cKDTree

from collalign.nonrigid.evaluation import MapErrors, MapEvaluator, draw_curves, summary
from collalign.nonrigid.match import match_prepared
from collalign.nonrigid.options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.portfolio import screening_refiner
from collalign.nonrigid.prepare import prepare_shape
from collalign.nonrigid.refine import dense_point_maps
from collalign.nonrigid.surface import SpectralShape
from data_tools.cleaning import clean
from data_tools.datasets import Dataset, read_registered_archive, read_registered_folder, read_shrec07_class
from data_tools.sampling import farthest_points
from data_tools.shape import Shape
from data_tools.synthetic import shuffled

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
SPARSE = ("ant", "teddy", "glasses")
#: Points at which maps between registered meshes are evaluated.
NUM_EVALUATED = 200
#: Share of the triangles that a remeshed copy keeps.
REMESHED_SHARE = 0.6


@dataclass
class Copy:
    """A shape in the variant under test, and its vertices nearest to those of the original."""

    shape: Shape
    from_original: np.ndarray


def pair_names(name: str, data: Dataset) -> list[tuple[str, str]]:
    """Return the benchmark's (target, source) pairs that the data allow."""
    if name == "tosca":
        return list(combinations(data.names, 2))
    if name == "scape":
        words = (DATA / "scape71" / "Corr_Scape.query").read_text().split()
        ids = [(int(words[i + 2]), int(words[i + 5])) for i in range(0, len(words), 6)]
        pairs = [(f"mesh{target:03d}", f"mesh{source:03d}") for source, target in ids]
        return [pair for pair in pairs if set(pair) <= set(data.names)]
    return [(row["target"], row["source"]) for row in published(name, data)]


def published(name: str, data: Dataset) -> list[dict[str, str]]:
    """Return the rows of the published errors of blended intrinsic maps on this set."""
    folder = "scape71" if name == "scape" else "shrec07_dev"
    with (DATA / folder / "bim2011_published_errors.csv").open() as stream:
        rows = [row for row in csv.DictReader(stream) if row["method"] == "BlendedMap"]
    return [row for row in rows if {row["source"], row["target"]} <= set(data.names)]


def read(name: str) -> Dataset:
    if name == "scape":
        return read_registered_archive(DATA / "scape71")
    if name == "tosca":
        return read_registered_folder(DATA / "tosca_centaur6")
    return read_shrec07_class(DATA / "shrec07_dev" / name)


def vary(shape: Shape, variant: str, seed: int) -> Copy:
    """Return the shape as it is, with its vertices in another order, or with another triangulation."""
    if variant == "permuted":
        copy, order = shuffled(shape, np.random.default_rng(seed))
        return Copy(copy, np.argsort(order))
    if variant == "remeshed":
        target = round(REMESHED_SHARE * len(shape.faces))
        vertices, faces = fast_simplification.simplify(
            np.array(shape.vertices), np.array(shape.faces), target_count=target
        )
        copy = clean(shuffled(Shape.from_arrays(vertices, faces, name=shape.name), np.random.default_rng(seed))[0])
        return Copy(copy, cKDTree(copy.vertices).query(shape.vertices)[1])
    return Copy(shape, np.arange(len(shape.vertices)))


def dense_mirror(shape: Shape, data: Dataset, prepared: SpectralShape) -> np.ndarray | None:
    """Return the mirror image of each vertex of registered meshes: the self-map that the landmarks confirm best."""
    if data.mirror is None or data.landmark_vertices is None or not data.vertices_correspond:
        return None
    marks = data.landmark_vertices[0]
    evaluator = MapEvaluator(shape, marks[data.mirror])
    refiner = screening_refiner(prepared, prepared)
    best, smallest = None, np.inf
    for self_map in prepared.self_maps:
        c = refiner.from_functional_map(self_map).C_source_target
        found = prepared.to_original[dense_point_maps(prepared, prepared, c)[0]][prepared.to_working]
        error = float(evaluator.errors(found[marks]).direct.mean())
        if error < smallest:
            best, smallest = found, error
    print(f"# mirrored truth: a self-map of {shape.name}, mean error at its landmarks {smallest:.4f}")
    return best


class Collection:
    """The shapes of a set, read, varied and prepared when first needed."""

    def __init__(self, name: str, variant: str, cache: Path | None) -> None:
        self.name, self.variant, self.cache = name, variant, cache
        self.data = read(name)
        self._copies: dict[str, Copy] = {}
        self.prepare_s: list[float] = []

    def copy(self, name: str) -> Copy:
        if name not in self._copies:
            self._copies[name] = vary(self.data.shape(name), self.variant, self.data.index(name))
        return self._copies[name]

    def prepared(self, name: str) -> SpectralShape:
        file = None if self.cache is None else self.cache / f"{self.name}_{self.variant}_{name}.npz"
        if file is not None and file.exists():
            return SpectralShape.load(file)
        started = time.process_time()
        shape = prepare_shape(self.copy(name).shape, SurfaceOptions())
        self.prepare_s.append(time.process_time() - started)
        if file is not None:
            shape.save(file)
        return shape

    def evaluated(self, source: str) -> np.ndarray:
        """Return the original vertices (or the landmarks) of the source at which maps are evaluated."""
        if self.name in SPARSE:
            assert self.data.landmark_vertices is not None
            return self.data.landmark_vertices[self.data.index(source)]
        return farthest_points(self.data.shape(source), NUM_EVALUATED, metric="euclidean")

    def truth(
        self, target: str, points: np.ndarray, mirror: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Return the original target vertices of the evaluated points, and of their mirror images."""
        if self.name in SPARSE:
            assert self.data.landmark_vertices is not None
            marks = self.data.landmark_vertices[self.data.index(target)]
            return marks, None if self.data.mirror is None else marks[self.data.mirror]
        return points, None if mirror is None else mirror[points]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", choices=("scape", "tosca", *SPARSE))
    parser.add_argument("--variant", choices=("original", "permuted", "remeshed"), default="original")
    parser.add_argument("--strategy", choices=("portfolio", "paper", "fast"), default="portfolio")
    parser.add_argument("--mask", choices=("wks", "agd", "none"), default=None)
    parser.add_argument("--bandwidth", type=int, default=2)
    parser.add_argument("--refinement", choices=("zoomout", "icp"), default=None)
    parser.add_argument("--relaxation", action="store_true", help="add PM-SDP to the portfolio")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--limit", type=int, default=None, help="number of pairs")
    parser.add_argument("--time-limit", type=float, default=None, help="seconds for the relaxation of a pair")
    parser.add_argument("--cache", type=Path, default=None, help="folder for prepared shapes")
    parser.add_argument("--curves", type=Path, default=None, help="PNG file for the cumulative curves")
    arguments = parser.parse_args()
    options = NonrigidOptions(
        strategy=arguments.strategy,
        mask=arguments.mask,
        bandwidth=arguments.bandwidth,
        refinement=arguments.refinement,
        use_relaxation=arguments.relaxation,
        time_limit_s=arguments.time_limit,
    )
    collection = Collection(arguments.set, arguments.variant, arguments.cache)
    pairs = pair_names(arguments.set, collection.data)[arguments.first :]
    run(collection, pairs[: arguments.limit], options, arguments.curves)


def run(collection: Collection, pairs: list[tuple[str, str]], options: NonrigidOptions, curves: Path | None) -> None:
    data = collection.data
    mirror = None
    if data.vertices_correspond and collection.variant == "original":
        mirror = dense_mirror(data.shape(0), data, collection.prepared(data.names[0]))
    found: list[MapErrors] = []
    seconds: list[float] = []
    origins: list[str] = []
    for target, source in pairs:
        prepared = collection.prepared(target), collection.prepared(source)
        started = time.process_time()
        match = match_prepared(*prepared, options)
        seconds.append(time.process_time() - started)
        points = collection.evaluated(source)
        to, of = collection.copy(target), collection.copy(source)
        truth, mirrored = collection.truth(target, points, mirror)
        evaluator = MapEvaluator(
            to.shape, to.from_original[truth], None if mirrored is None else to.from_original[mirrored]
        )
        errors = evaluator.errors(match.point_map_target_source[of.from_original[points]])
        found.append(errors)
        origins.append(match.candidates[0].origin)
        print(
            f"{target} {source}  direct {errors.direct.mean():.4f}  flips {errors.accepting_flips.mean():.4f}  "
            f"max {errors.direct.max():.3f}  confidence {match.confidence:.2f}  {match.orientation}  {origins[-1]}  "
            f"{match.status.name}  {seconds[-1]:.2f} s",
            flush=True,
        )
    direct, flips = [e.direct for e in found], [e.accepting_flips for e in found]
    for label, errors_of in (("direct", direct), ("accepting flips", flips)):
        print(label, {key: round(value, 4) for key, value in summary(errors_of).items()})
    print("origins", {origin: origins.count(origin) for origin in sorted(set(origins))})
    prepare = f", preparation {np.mean(collection.prepare_s):.2f} s a shape" if collection.prepare_s else ""
    print(f"processor time: {np.mean(seconds):.2f} s a pair{prepare}")
    if collection.name != "tosca":
        rows = {(row["target"], row["source"]): row for row in published(collection.name, data)}
        values = [float(rows[pair]["average_geodesic_error"]) for pair in pairs if pair in rows]
        if values:
            print(f"blended intrinsic maps, published, {len(values)} of these pairs: {np.mean(values):.4f}")
    if curves is not None:
        print(draw_curves(curves, {"direct": direct, "accepting flips": flips}))


if __name__ == "__main__":
    sys.exit(main())
