"""Collections in which some shapes lack a part, scans of which none is complete, and what looking for them costs."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from collalign.align import align_collection
from collalign.confidence.incomplete_model import PAIR_WEIGHT, share_of_best
from collalign.engine.run_options import RunOptions
from collalign.engine.store.records import Record
from collalign.options import ALL, AUTO, NEVER, AlignOptions
from collalign.output.collection import Collection
from collalign.products.trust import DOUBT
from collalign.tools.match.in_part import match_in_part
from data_tools.arrays import FloatArray, IntArray
from data_tools.embedding.embedding import Samples, sample_shape
from data_tools.embedding.surface_points import spread_points
from data_tools.errors import InputError
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from experiments.clock import stopwatch
from experiments.collections.landmarked import RIGHT_DEG, read_dataset
from experiments.collections.posed import PosedCollection, pose_collection
from experiments.datasets import Dataset, read_range_scans
from experiments.experiment import Cell
from experiments.pairs.invariants import without_share
from experiments.tables import Column, Row
from pairwise.partial.match import SearchedPose
from pairwise.partial.surface import MOST_POINTS, PartialSurface

#: The Stanford bunny's range scans; those that share less than this of their points are not matched.
SCANS_FOLDER, MIN_OVERLAP = "stanford_bunny_scans", 0.3
#: What is cut off: beyond a plane of random direction, or the front of a skull.
RANDOM, ROSTRUM = "random", "rostrum"
#: Landmarks at the front end of a mouse skull.
_SKULL_TIP = (0, 1)
#: How the incomplete shapes become known, and what the options say then.
TOLD = "told"


@contextmanager
def _cut_collection(settings: dict[str, Any], data: Path) -> Iterator[tuple[PosedCollection, list[str]]]:
    """Write some shapes of a collection in random poses, some of them cut; also yield the names of these."""
    dataset = read_dataset(settings["collection"], data)
    rng = np.random.default_rng(settings["seed"])
    chosen = rng.permutation(len(dataset))[: settings["shapes"]]
    with tempfile.TemporaryDirectory() as name:
        posed = pose_collection(dataset, chosen, Path(name), rng)
        cut = [dataset.names[i] for i in chosen[: settings["cut"]]]
        for i in chosen[: settings["cut"]]:
            file = Path(name) / f"{dataset.names[i]}.ply"
            shape = read_shape(file)
            direction = rng.standard_normal(3)
            if settings["what"] == ROSTRUM:
                direction = _to_the_tip(dataset, int(i), shape.vertices)
            write_mesh(file, without_share(shape, direction, settings["share"]))
        yield posed, sorted(cut)


def _to_the_tip(dataset: Dataset, which: int, posed: FloatArray) -> FloatArray:
    """Return the direction to the front of a skull whose vertices were turned."""
    stored = dataset.shape(which).vertices
    tip = dataset.landmarks[which, list(_SKULL_TIP)].mean(axis=0)  # type: ignore[index]
    ahead = (stored - stored.mean(axis=0)) @ (tip - stored.mean(axis=0))
    return np.asarray((posed - posed.mean(axis=0)).T @ ahead)


def measure_cut_collection(cell: Cell) -> Record:
    """Align a collection of which some shapes are cut, told or not, and the others without them."""
    settings = cell.settings
    with _cut_collection(settings, cell.data) as (posed, cut), tempfile.TemporaryDirectory() as name:
        options = AlignOptions(incomplete=",".join(cut) if settings["way"] == TOLD else settings["way"])
        run = RunOptions(jobs=1, store=Path(name) / "store.sqlite")
        with stopwatch() as elapsed:
            aligned = align_collection(posed.folder, options=options, run=run, progress=False)
        whole = [posed.folder / f"{shape}.ply" for shape in posed.names if shape not in cut]
        without = align_collection(whole, options=replace(options, incomplete=NEVER), run=run, progress=False)
    kept = [aligned.names.index(shape) for shape in without.names]
    return {
        **_figures(aligned, posed),
        "cut": cut,
        "named": [aligned.names[one.shape] for one in aligned.incomplete],
        "without_deg": posed.shape_errors_deg(without.rotations, without.names),
        "as_without": bool(np.array_equal(aligned.transforms[kept], without.transforms)),
        "processor_s": elapsed.processor_s,
    }


def _figures(aligned: Collection, posed: PosedCollection) -> Record:
    return {
        "names": list(aligned.names),
        "shape_deg": posed.shape_errors_deg(aligned.rotations, aligned.names),
        "confidence": np.array(aligned.confidence),
    }


def measure_scan_collection(cell: Cell) -> Record:
    """Align range scans of one object, of which none is complete; the first ones, in random poses."""
    settings = cell.settings
    dataset = read_range_scans(cell.data / SCANS_FOLDER)
    rng, chosen = np.random.default_rng(settings["seed"]), np.arange(min(settings["scans"], len(dataset)))
    with tempfile.TemporaryDirectory() as name:
        posed = pose_collection(dataset, chosen, Path(name), rng)
        options = AlignOptions(group="SO", scaling="rigid", incomplete=ALL)
        with stopwatch() as elapsed:
            aligned = align_collection(posed.folder, options=options, run=RunOptions(jobs=1), progress=False)
    coverage = np.array([one.coverage for one in aligned.incomplete])
    return {**_figures(aligned, posed), "coverage": coverage, "processor_s": elapsed.processor_s}


def measure_scan_pairs(cell: Cell) -> Record:
    """Match every two range scans that overlap enough, sizes kept: overlaps, errors in degrees, chances."""
    settings = cell.settings
    dataset = read_range_scans(cell.data / SCANS_FOLDER)
    rng, chosen = np.random.default_rng(settings["seed"]), range(min(settings["scans"], len(dataset)))
    sampling = SamplingOptions(metric="euclidean", normalisation="none")
    samples = [sample_shape(dataset.shape(i), sampling, EmbeddingOptions(kind="xyz")) for i in chosen]
    found: dict[str, list[float]] = {key: [] for key in ("overlap", "best", "chance", "seconds")}
    for i, j in itertools.combinations(chosen, 2):
        turn, overlap = random_rotation(rng), overlap_share(dataset, samples, i, j)
        if overlap < MIN_OVERLAP:
            continue
        shape = dataset.shape(j)
        source = Shape.from_arrays(shape.vertices @ turn.T, shape.faces, name=shape.name)
        with stopwatch() as elapsed:
            match = match_in_part(dataset.shape(i), source, sampling=sampling)
        found["overlap"].append(overlap)
        found["best"].append(float(rotation_angle_deg(match.transform[:3, :3], dataset.rotation(i, j) @ turn.T)))
        found["chance"].append(match.confidence)
        found["seconds"].append(elapsed.processor_s)
    return dict(found)


def surface_of(shape: Shape) -> PartialSurface:
    """Return what is matched of a shape."""
    points = spread_points(shape, MOST_POINTS)
    return PartialSurface.from_user(points.points, points.normals, points.on_rim, oriented=points.oriented)


def chance_of(poses: Sequence[SearchedPose]) -> float:
    """Return the chance that the best pose of a search is right, as ``collalign match --partial`` states it."""
    turns = np.stack([found.pose.rotation for found in poses])
    return share_of_best(turns, -PAIR_WEIGHT * np.log([found.energy for found in poses]))


def measure_complete_collection(cell: Cell) -> Record:
    """Align a collection that lacks nothing, with and without looking for incomplete shapes."""
    settings = cell.settings
    dataset = read_dataset(settings["collection"], cell.data)
    rng = np.random.default_rng(settings["seed"])
    chosen: IntArray = rng.permutation(len(dataset))[: settings["shapes"]]
    found, seconds = {}, {}
    with tempfile.TemporaryDirectory() as name:
        posed = pose_collection(dataset, chosen, Path(name), rng)
        for way in (NEVER, AUTO):
            with stopwatch() as elapsed:
                found[way] = align_collection(
                    posed.folder, options=AlignOptions(incomplete=way), run=RunOptions(jobs=1), progress=False
                )
            seconds[way] = elapsed.processor_s
    return {
        "same": bool(np.array_equal(found[AUTO].transforms, found[NEVER].transforms)),
        "named": [found[AUTO].names[one.shape] for one in found[AUTO].incomplete],
        "never_s": seconds[NEVER],
        "auto_s": seconds[AUTO],
    }


CUT_COLUMNS = (
    Column(key="collection", title="collection"),
    Column(key="shapes", title="shapes"),
    Column(key="cut", title="cut"),
    Column(key="share", title="cut off, %", format=".0f"),
    Column(key="way", title="incomplete shapes are"),
    Column(key="named", title="cut ones named"),
    Column(key="wrongly", title="whole ones named"),
    Column(key="right", title="cut ones right"),
    Column(key="whole", title="whole ones right"),
    Column(key="without", title="of these, without the cut ones"),
    Column(key="worst", title="worst cut one, deg", format=".1f"),
    Column(key="noticed", title="wrong ones in doubt"),
    Column(key="same", title="whole ones the same as without"),
    Column(key="seconds", title="processor s", format=".0f", clock=True),
)
SCAN_COLUMNS = (
    Column(key="scans", title="scans"),
    Column(key="within_5", title="within 5 deg"),
    Column(key="within_20", title="within 20 deg"),
    Column(key="worst", title="worst, deg", format=".1f"),
    Column(key="noticed", title="wrong ones in doubt"),
    Column(key="doubtful", title="right ones in doubt"),
    Column(key="seconds", title="processor s", format=".0f", clock=True),
)
SCAN_PAIR_COLUMNS = (
    Column(key="overlap", title="overlap, %"),
    Column(key="pairs", title="pairs"),
    Column(key="right", title="right, %", format=".0f"),
    Column(key="noticed", title="wrong ones in doubt"),
    Column(key="doubtful", title="right ones in doubt"),
    Column(key="median", title="median error, deg", format=".1f"),
    Column(key="seconds", title="processor s a pair", format=".1f", clock=True),
)
COMPLETE_COLUMNS = (
    Column(key="collection", title="collection"),
    Column(key="shapes", title="shapes"),
    Column(key="named", title="named incomplete"),
    Column(key="same", title="same transforms"),
    Column(key="ratio", title="processor time, looked for : not", format=".2f", clock=True),
)


def cut_row(settings: dict[str, Any], record: Record) -> Row:
    """Return what became of the cut shapes, and of the others."""
    names, errors, cut = record["names"], np.array(record["shape_deg"]), set(record["cut"])
    is_cut = np.array([name in cut for name in names])
    wrong, doubtful = errors > RIGHT_DEG, np.array(record["confidence"]) < DOUBT
    return {
        "collection": settings["collection"],
        "shapes": len(names),
        "cut": len(cut),
        "share": 100.0 * settings["share"],
        "way": "told" if settings["way"] == TOLD else "looked for" if settings["way"] == AUTO else "unknown",
        "named": len(cut & set(record["named"])),
        "wrongly": len(set(record["named"]) - cut),
        "right": int((~wrong & is_cut).sum()),
        "whole": int((~wrong & ~is_cut).sum()),
        "without": int((np.array(record["without_deg"]) <= RIGHT_DEG).sum()),
        "worst": float(errors[is_cut].max()),
        "noticed": f"{int((wrong & doubtful).sum())} of {int(wrong.sum())}",
        "same": "yes" if record["as_without"] else "no",
        "seconds": record["processor_s"],
    }


def scan_row(record: Record) -> Row:
    """Return how many scans are right."""
    errors, doubtful = np.array(record["shape_deg"]), np.array(record["confidence"]) < DOUBT
    wrong = errors > RIGHT_DEG
    return {
        "scans": len(errors),
        "within_5": int((errors <= 5.0).sum()),
        "within_20": int((~wrong).sum()),
        "worst": float(errors.max()),
        "noticed": f"{int((wrong & doubtful).sum())} of {int(wrong.sum())}",
        "doubtful": int((~wrong & doubtful).sum()),
        "seconds": record["processor_s"],
    }


def scan_pair_rows(record: Record) -> list[Row]:
    """Return the shares of right pairs of scans by their overlap."""
    overlap, errors, seconds = (np.array(record[key]) for key in ("overlap", "best", "seconds"))
    wrong, doubtful = errors > RIGHT_DEG, np.array(record["chance"]) < DOUBT
    rows: list[Row] = []
    for low, high in ((0.3, 0.5), (0.5, 0.7), (0.7, 1.01)):
        chosen = (overlap >= low) & (overlap < high)
        if chosen.any():
            rows.append(
                {
                    "overlap": f"{100 * low:.0f} to {100 * min(high, 1.0):.0f}",
                    "pairs": int(chosen.sum()),
                    "right": 100.0 * float((~wrong[chosen]).mean()),
                    "noticed": f"{int((wrong & doubtful & chosen).sum())} of {int((wrong & chosen).sum())}",
                    "doubtful": int((~wrong & doubtful & chosen).sum()),
                    "median": float(np.median(errors[chosen])),
                    "seconds": float(seconds[chosen].mean()),
                }
            )
    return rows


def complete_row(settings: dict[str, Any], record: Record) -> Row:
    """Return whether looking for incomplete shapes changed anything where there are none, and its cost."""
    return {
        "collection": settings["collection"],
        "shapes": settings["shapes"],
        "named": len(record["named"]),
        "same": "yes" if record["same"] else "no",
        "ratio": record["auto_s"] / record["never_s"],
    }


def overlap_share(dataset: Dataset, samples: list[Samples], i: int, j: int) -> float:
    """Return the share of the dense samples of both scans with a counterpart in the other, at the known poses."""
    if dataset.rotations is None or dataset.translations is None:
        raise InputError(f"{SCANS_FOLDER}: the poses of the scans are not known")
    clouds = [
        (samples[s].dense_positions * samples[s].scale + samples[s].offset) @ dataset.rotations[s].T
        + dataset.translations[s]
        for s in (i, j)
    ]
    spacing = np.median(cKDTree(clouds[0]).query(clouds[0], k=2)[0][:, 1])
    near = [cKDTree(a).query(b)[0] <= spacing for a, b in (clouds, clouds[::-1])]
    return float(np.concatenate(near).mean())
