"""Scans that each show a part of one object: pairs of them and whole sets, compared with other tools."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import cKDTree

from collalign import AlignOptions, RunOptions, align_collection, match_in_part
from collalign.engine.records import Record
from collalign.products.trust import DOUBT
from data_tools.arrays import FloatArray, IntArray
from data_tools.datasets.synthetic import range_view
from data_tools.embedding.surface_points import centre_and_radius
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from experiments.clock import stopwatch
from experiments.collections.posed import GROSS_DEG, PosedCollection
from experiments.datasets import read_canonical_class, read_range_scans
from experiments.experiment import Bench, Cell, Experiment, Outcome, Plot
from experiments.importable import is_importable
from experiments.peers.capod import FOLDER as CAPOD_FOLDER
from experiments.peers.peer_pairs import (
    MatchedPairs,
    drift_pairs,
    kiss_pairs,
    open3d_pairs,
    open3d_pose_graph,
    spectral,
)
from experiments.tables import Column, Row, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEED = 3
BUNNY, SCANS_FOLDER = "bunny, ten range scans", "stanford_bunny_scans"
#: Objects of CAPOD, the first of its class each, of which views are generated.
OBJECTS = ("dolphin", "horse", "piano", "spider")
#: Views all around, the height of the camera, pixels across four radii, and noise in radii.
NUM_VIEWS, ELEVATION, PIXELS, NOISE = 15, 0.2, 90, 0.003
#: How far views of a pair are apart, in steps of 24 degrees.
GAPS = (1, 2, 3, 4)
#: A pair is right within this angle: a fine registration does the rest.
RIGHT_DEG = 16.0
#: A scan of a collection is wrong beyond this angle.
WRONG_DEG = 20.0
#: Shares of the scans' points with a counterpart that pairs of the bunny's scans are told apart by.
OVERLAPS = (0.3, 0.5, 0.7, 1.01)
#: Raised when the toolkit's poses change.
VERSION = "4"

_ABOUT = f"""
**Data.** The ten range scans of the Stanford bunny (Stanford Computer Graphics Laboratory; research use), and
{NUM_VIEWS} generated depth images each of a dolphin, a horse, a piano and a spider of CAPOD (P. Papadakis 2014, CC BY
3.0), {360 // NUM_VIEWS} degrees apart, at {PIXELS} pixels across four root mean square radii and with a noise of
{NOISE:.1%} of the radius. All are points without normals, in uniformly random poses and of known size.

**Rule.** That of published tables of pairs: a pair is right within {RIGHT_DEG:.0f} degrees, at 24, 48, 72 and 96
degrees apart ({NUM_VIEWS} pairs each); of the bunny's scans by the share of points with a counterpart. As a
collection, pairs beyond {GROSS_DEG:.0f} degrees count as gross, as everywhere. Where the toolkit says that overlaps
do not join all scans, pairs of two *parts* count as gross all the same. Its confidences are of poses within a part,
and *wrong at {DOUBT}* counts these.

* collalign: pairs by `match_in_part` with sizes kept; collections by `align_collection` with `scaling="rigid"` and
  `group="SO"`, and not told that these are scans.
* Open3D: voxels of a tenth of the radius, normals estimated as in its tutorial, FPFH, RANSAC and ICP; then its
  multiway pose graph or spectral synchronization.
* KISS-Matcher with the generalised ICP of small_gicp, and coherent point drift (rustcpd, 200 points, from the
  pairings of the principal axes), both with spectral synchronization.

CPU seconds of a pair or of the whole collection. Weights of the chance of a pair were chosen on generated depth
images of other objects (a person, a bird, a chair, a teddy bear, an ant and two generated blobs); the bunny was
looked at while the method was developed, and a horse when an earlier one was tried.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scans:
    """Scans of one object in random poses.

    Attributes
    ----------
    clouds : tuple of Shape, length N
    relative : ndarray, shape (N, N, 3, 3)
        True ``R_i_j``.
    apart : ndarray of int, shape (N, N)
        Position in :data:`GAPS`, or of the bunny in :data:`OVERLAPS`; -1 where a pair does not count.
    """

    clouds: tuple[Shape, ...]
    relative: FloatArray
    apart: IntArray


def read_scans(name: str, data: Path, num: int, seed: int = SEED) -> Scans:
    """Return the first scans of the bunny, or generated views of an object of CAPOD, rotated and moved at random."""
    rng = np.random.default_rng(seed)
    if name == BUNNY:
        dataset = read_range_scans(data / SCANS_FOLDER)
        points = [dataset.shape(i).vertices for i in range(num)]
        frames = [
            (np.asarray(dataset.rotations)[i], np.asarray(dataset.translations)[i])
            for i in range(num)
        ]
        common = [cloud @ R.T + t for cloud, (R, t) in zip(points, frames, strict=True)]
        true = np.stack([R for R, _ in frames])
        apart = np.digitize(overlaps(common), OVERLAPS) - 1
    else:
        whole = read_canonical_class(data / CAPOD_FOLDER / name).shape(0)
        angles = 2.0 * np.pi * np.arange(num) / NUM_VIEWS
        sights = np.column_stack([np.cos(angles), np.sin(angles), np.full(num, ELEVATION)])
        points = [range_view(whole, sight, pixels=PIXELS, noise=NOISE, rng=rng) for sight in sights]
        true = np.tile(np.eye(3), (num, 1, 1))
        steps = np.abs(np.subtract.outer(np.arange(num), np.arange(num)))
        steps = np.minimum(steps, NUM_VIEWS - steps)
        apart = np.where(np.isin(steps, GAPS), steps - 1, -1)
    rotations = [random_rotation(rng) for _ in points]
    radius = float(np.mean([centre_and_radius(Shape.from_arrays(cloud))[1] for cloud in points]))
    moved = [
        cloud / radius @ rotation.T + rng.standard_normal(3)
        for cloud, rotation in zip(points, rotations, strict=True)
    ]
    poses = np.stack([R @ rotation.T for R, rotation in zip(true, rotations, strict=True)])
    return Scans(
        clouds=tuple(
            Shape.from_arrays(cloud, name=f"scan{i:02d}") for i, cloud in enumerate(moved)
        ),
        relative=np.einsum("ica,jcb->ijab", poses, poses),
        apart=apart,
    )


def overlaps(clouds: Sequence[FloatArray], num_points: int = 2000) -> FloatArray:
    """Return the share of points of every two clouds of one frame that are near the other, shape (N, N)."""
    rng = np.random.default_rng(SEED)
    few = [cloud[rng.permutation(len(cloud))[:num_points]] for cloud in clouds]
    trees = [cKDTree(cloud) for cloud in few]
    reach = 2.0 * float(
        np.median([np.median(tree.query(tree.data, k=2)[0][:, 1]) for tree in trees])
    )
    near = np.array(
        [[float((tree.query(cloud)[0] <= reach).mean()) for tree in trees] for cloud in few]
    )
    return np.asarray(0.5 * (near + near.T))


@dataclass(frozen=True, kw_only=True)
class Matcher:
    """Another tool's pairs, the ways to synchronize them, and the packages it needs."""

    match: Callable[[Sequence[Shape], int], MatchedPairs]
    ways: dict[str, Callable[[MatchedPairs], FloatArray]]
    packages: tuple[str, ...]

    @property
    def lacks(self) -> bool:
        """Whether a package cannot be imported."""
        return not all(map(is_importable, self.packages))


MATCHERS = {
    "Open3D": Matcher(
        match=open3d_pairs,
        ways={"pose graph": open3d_pose_graph, "spectral": spectral},
        packages=("open3d",),
    ),
    "KISS-Matcher + GICP": Matcher(
        match=kiss_pairs, ways={"spectral": spectral}, packages=("kiss_matcher", "small_gicp")
    ),
    "principal axes + CPD": Matcher(
        match=drift_pairs, ways={"spectral": spectral}, packages=("rustcpd",)
    ),
}
OURS = "collalign"


def measure_scans(cell: Cell) -> Record:
    """Match the pairs of one object's scans with one tool, and join all scans.

    Settings: ``name``, ``num`` (scans) and ``tool``.

    Returns
    -------
    dict
        ``pair_deg`` (E,) and ``apart`` (E,) of the pairs that count, ``pair_s`` of one; ``ways``: for each way to
        join the scans ``errors`` of all pairs, ``processor_s``, and of this toolkit ``stated`` and ``sure_wrong``.
    """
    settings = cell.settings
    scans = read_scans(settings["name"], cell.data, settings["num"])
    edges = [e for e in itertools.combinations(range(len(scans.clouds)), 2) if scans.apart[e] >= 0]
    run = _run_toolkit if settings["tool"] == OURS else _run_matcher
    pairs, pair_s, ways = run(scans, edges, settings["tool"])
    true = np.array([scans.relative[edge] for edge in edges])
    return {
        "pair_deg": rotation_angle_deg(pairs, true),
        "apart": np.array([scans.apart[edge] for edge in edges]),
        "pair_s": pair_s,
        "ways": ways,
    }


def _run_toolkit(
    scans: Scans, edges: list[tuple[int, int]], tool: str
) -> tuple[FloatArray, float, Record]:
    with stopwatch() as matching:
        found = [
            match_in_part(
                *(scans.clouds[at].vertices for at in edge),
                group="SO",
                sampling={"normalisation": "none"},
            )
            for edge in edges
        ]
    with stopwatch() as elapsed:
        aligned = align_collection(
            {cloud.name: cloud.vertices for cloud in scans.clouds},
            options=AlignOptions(group="SO", scaling="rigid"),
            run=RunOptions(jobs=1),
            progress=False,
        )
    figures = _figures(scans, aligned.rotations, aligned.names) | {
        "processor_s": elapsed.processor_s
    }
    del figures["shape_deg"]
    sure, parts = aligned.confidence >= DOUBT, aligned.part_numbers
    wrong = np.zeros(len(sure), dtype=bool)
    for part in np.unique(parts).tolist():
        members = np.flatnonzero(parts == part)
        names = [aligned.names[i] for i in members]
        wrong[members] = _figures(scans, aligned.rotations[members], names)["shape_deg"] > WRONG_DEG
    figures |= {
        "stated": float(sure.mean()),
        "sure_wrong": int((sure & wrong).sum()),
        "parts": int(parts.max()) + 1,
    }
    pairs = np.stack([one.transform[:3, :3] for one in found])
    return pairs, matching.processor_s / len(edges), {OURS: figures}


def _run_matcher(
    scans: Scans, edges: list[tuple[int, int]], tool: str
) -> tuple[FloatArray, float, Record]:
    with stopwatch() as matching:
        found = MATCHERS[tool].match(scans.clouds, 1)
    ways: Record = {}
    for way, synchronizer in MATCHERS[tool].ways.items():
        with stopwatch() as rest:
            rotations = synchronizer(found)
        figures = _figures(scans, rotations, [cloud.name for cloud in scans.clouds])
        del figures["shape_deg"]
        ways[f"{tool}, {way}"] = figures | {"processor_s": matching.processor_s + rest.processor_s}
    at = {tuple(edge): k for k, edge in enumerate(found.edges.tolist())}
    pairs = np.stack([found.transforms[at[edge], :3, :3] for edge in edges])
    return pairs, matching.processor_s / len(found.edges), ways


def _figures(scans: Scans, rotations: FloatArray, names: Sequence[str]) -> Record:
    posed = PosedCollection(
        folder=Path(), names=tuple(cloud.name for cloud in scans.clouds), relative=scans.relative
    )
    return {
        "errors": np.nan_to_num(posed.pair_errors_deg(rotations, names), nan=180.0),
        "shape_deg": posed.shape_errors_deg(rotations, names),
    }


def measure(bench: Bench) -> Outcome:
    """Run all tools that are installed on all objects; with ``--quick`` four views of one."""
    bench.seeds.add(SEED)
    names = OBJECTS[1:2] if bench.quick else (BUNNY, *OBJECTS)
    tools = [OURS, *(name for name, matcher in MATCHERS.items() if not matcher.lacks)]
    cells: dict[str, dict[str, Any]] = {
        f"{name}: {tool}": {
            "name": name,
            "num": 4 if bench.quick else 10 if name == BUNNY else NUM_VIEWS,
            "tool": tool,
        }
        for name in names
        for tool in tools
    }
    found = bench.measure(measure_scans, cells, version=VERSION, apart=True)
    objects = [name for name in names if name != BUNNY]
    pairs = [
        pair_row(f"{len(objects)} objects", tool, [found[f"{name}: {tool}"] for name in objects])
        for tool in tools
    ]
    if BUNNY in names:
        pairs += [pair_row(BUNNY, tool, [found[f"{BUNNY}: {tool}"]]) for tool in tools]
    joined = [
        joined_row(name, way, found[f"{name}: {tool}"]["ways"][way])
        for name in names
        for tool in tools
        for way in found[f"{name}: {tool}"]["ways"]
    ]
    lacking = [name for name, matcher in MATCHERS.items() if matcher.lacks]
    return Outcome(
        tables=(
            Table(
                columns=PAIR_COLUMNS,
                rows=tuple(pairs),
                caption=f"Pairs within {RIGHT_DEG:.0f} degrees. Classes of the bunny's: 30 to 50, 50 to 70 and 70 to "
                "100 % shared points.",
            ),
            Table(
                name="collections",
                columns=JOINED_COLUMNS,
                rows=tuple(joined),
                caption="All scans of an object.",
            ),
        ),
        plots=(_plot(pairs[: len(tools)]),),
        text=f"Left out, since they cannot be imported: {', '.join(lacking)}." if lacking else "",
    )


def pair_row(name: str, tool: str, records: list[Record]) -> Row:
    """Return how many pairs of each class are right."""
    errors, apart = (
        np.concatenate([record[key] for record in records]) for key in ("pair_deg", "apart")
    )
    row: dict[str, Any] = {"scans": name, "tool": tool}
    for k in range(len(GAPS)):
        chosen = apart == k
        if chosen.any():
            row[f"class_{k}"] = f"{int((errors[chosen] <= RIGHT_DEG).sum())} of {int(chosen.sum())}"
    row |= {
        "right": 100.0 * float((errors <= RIGHT_DEG).mean()),
        "seconds": float(np.mean([record["pair_s"] for record in records])),
    }
    return row


def joined_row(name: str, way: str, figures: Record) -> Row:
    """Return how right all scans together are."""
    errors = np.array(figures["errors"])
    row: dict[str, Any] = {
        "scans": name,
        "tool": way,
        "gross": 100.0 * float((errors > GROSS_DEG).mean()),
        "median": float(np.median(errors)),
        "processor_s": figures["processor_s"],
    }
    if "stated" in figures:
        row |= {
            "parts": figures["parts"],
            "stated": 100.0 * figures["stated"],
            "sure_wrong": figures["sure_wrong"],
        }
    return row


PAIR_COLUMNS = (
    Column(key="scans", title="scans of"),
    Column(key="tool", title="tool"),
    *(
        Column(key=f"class_{k}", title=f"{gap * 360 // NUM_VIEWS} deg apart")
        for k, gap in enumerate(GAPS)
    ),
    Column(key="right", title="all, %", format=".0f"),
    Column(key="seconds", title="CPU, s a pair", format=".2f", clock=True),
)
JOINED_COLUMNS = (
    Column(key="scans", title="scans of"),
    Column(key="tool", title="tool"),
    Column(key="gross", title="gross pairs, %", format=".1f"),
    Column(key="median", title="median error, deg", format=".1f"),
    Column(key="parts", title="parts"),
    Column(key="stated", title=f"stated at {DOUBT}, %", format=".0f"),
    Column(key="sure_wrong", title=f"wrong at {DOUBT}"),
    Column(key="processor_s", title="CPU, s", format=".0f", clock=True),
)


def _plot(rows: list[Row]) -> Plot:
    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for row in rows:
            counts = [
                str(row[f"class_{k}"]).split(" of ")
                for k in range(len(GAPS))
                if f"class_{k}" in row
            ]
            shares = [100.0 * int(right) / int(all_) for right, all_ in counts]
            axes.plot(
                [gap * 360 // NUM_VIEWS for gap in GAPS[: len(shares)]],
                shares,
                "o-",
                label=str(row["tool"]),
            )
        axes.set_xlabel("views apart, degrees")
        axes.set_ylabel(f"pairs within {RIGHT_DEG:.0f} degrees, %")
        axes.set_ylim(0, 102)
        axes.legend(fontsize=8)

    return Plot(
        draw=draw, title="Right pairs of generated views by the angle between them", size=(6.0, 4.0)
    )


EXPERIMENT = Experiment(
    name="scans",
    title="Partial scans: pairs and whole sets, compared with other tools",
    about=_ABOUT,
    measure=measure,
    collections=(CAPOD_FOLDER, SCANS_FOLDER),
)
