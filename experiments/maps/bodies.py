"""Maps between bodies of different kinds: is the right map among the candidates, is it chosen, is it known to be."""

from __future__ import annotations

import tempfile
import time
from dataclasses import astuple, fields
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from collalign import AlignOptions, RunOptions, align_collection
from collalign.confidence.map_model import NEAR, Evidence, map_probability, map_terms
from collalign.engine.records import Record
from collalign.nonrigid.map_options import NonrigidOptions
from collalign.nonrigid.portfolio import Refined, point_terms, standing
from collalign.nonrigid.ranked import ranked_maps
from collalign.nonrigid.spectral_shape import SpectralShape
from collalign.tools.match.every_vertex import vertex_maps
from data_tools.arrays import FloatArray, IntArray
from data_tools.io.shapes import write_mesh
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from experiments.experiment import Bench, Cell, Experiment, Outcome
from experiments.maps.evaluation import MapEvaluator
from experiments.maps.map_cells import (
    NUM_EVALUATED,
    QUICK_SURFACE,
    error_measure,
    evaluated_points,
    map_set,
    mirror_of,
    prepared,
    true_places,
)
from experiments.maps.map_sets import (
    ANIMALS,
    BIPEDS,
    BIPEDS_APART,
    BODIES,
    FOLDERS,
    SEED,
    Pair,
    kinds_of,
    read_map_set,
    some_pairs,
)
from experiments.maps.paper_chain import in_files
from experiments.tables import Column, Row, Table

#: Pairs of each set, at most.
SETS = {BIPEDS: 20, BIPEDS_APART: 40, BODIES: 20, ANIMALS: 9, "scape": 12, "tosca": 6}
#: Folders of bodies of several kinds: of which set, and how many of each kind.
MIXED = {
    BODIES: {"human": 6, "armadillo": 3},
    BIPEDS: {"person": 4, "ape": 3},
    BIPEDS_APART: {"person": 4, "gibbon": 2, "kangaroo": 2},
    ANIMALS: {"cat": 6, "dog": 4},
}
#: Raised when the maps change: of pairs, and of folders.
VERSION, MIXED_VERSION = "5", "3"
#: Columns of the evidence in a record.
EVIDENCE = tuple(one.name for one in fields(Evidence))
#: Maps that are stated this or more are sure.
SURE = 0.9
#: A candidate between kinds whose landmarks lie elsewhere counts as the right one up to this mean error.
FOUND_MEAN = 0.15

_ABOUT = f"""
Front and back of a body look alike to the inside of its surface: half turns about the long axis keep orientation.
*Generated bipeds* are one template of stretched, thickened and bent bones (`experiments/generated/bipeds.py`), each
decimated by itself, with dense truth. The first set has people, children, apes and armadillos. The kinds kept apart
are gibbons, kangaroos, giants and elves, with people: only the cost of a limb's length, by which ends of limbs are
matched, was set while looking at them. People and armadillos of SHREC07 are evaluated at 14 landmarks that were
chosen by hand, cats with dogs at 200 points, registered meshes at {NUM_EVALUATED}. Errors are geodesic, over the
square root of the target's area.

A map is *flipped* where it is nearer to the mirrored truth. The right map is *among the candidates* where one of them
has a mean error below {FOUND_MEAN}. A map is *sure* where it is stated {SURE} or more, and right where its mean error
is below {NEAR}. CPU time is of a pair, without the preparation of the two surfaces.

The second table has folders with bodies of several kinds, drawn at random and in random poses, aligned with
`--deformable`. All pairs of two kinds count. *Alone* they are matched as in the first table.
"""


def measure_body_map(cell: Cell) -> Record:
    """Match one pair and compare all candidates with the truth.

    Settings: ``set``, ``target``, ``source``, ``surface``, ``points``.

    Returns
    -------
    dict
        ``error`` and ``mirrored`` (NaN where unknown) of the map of all vertices, and ``seconds``. Of all candidates,
        the chosen one first: ``candidates`` (m,), the mean errors of the maps of samples; ``scores`` (m,);
        ``evidence`` (m, e), the fields of :class:`~collalign.confidence.map_model.Evidence`; ``standing`` (m, 2),
        see :func:`~collalign.nonrigid.portfolio.standing`; ``points`` (m, s, 2), what
        :func:`~collalign.confidence.map_model.point_probability` weighs of the evaluated points; ``in_place`` (m, s),
        whether these are near their true places, of the chosen one by its map of all vertices.
    """
    settings = cell.settings
    maps = map_set(cell.data, settings["set"])
    to, of = (prepared(cell.data, settings, settings[role]) for role in ("target", "source"))
    started = time.process_time()
    found = ranked_maps(to.spectral, of.spectral, NonrigidOptions())
    forward = vertex_maps(to.spectral, of.spectral, found[0])[0]
    seconds = time.process_time() - started
    mirror = mirror_of(cell.data, settings) if maps.data.vertices_correspond else None
    errors_of = error_measure(maps, settings, mirror)
    errors = errors_of(forward)
    of_samples = [errors_of(images_of(one, to.spectral, of.spectral)).direct for one in found]
    at = of.spectral.nearest_dense[
        of.spectral.to_working[evaluated_points(maps, settings["source"], settings["points"])]
    ]
    return {
        "error": float(errors.direct.mean()),
        "mirrored": float("nan") if errors.mirrored is None else float(errors.mirrored.mean()),
        "seconds": seconds,
        "candidates": np.array([one.mean() for one in of_samples]),
        "in_place": np.stack([errors.direct, *of_samples[1:]]) <= NEAR,
        **weighed(to.spectral, of.spectral, found, at),
    }


def measure_folder(cell: Cell) -> Record:
    """Map all vertices of a folder of bodies, and compare maps between kinds with the truth.

    Settings: ``set``, ``names``, ``pairs`` (targets and sources), ``seed``.

    Returns
    -------
    dict
        ``errors`` and ``mirrored`` (NaN where unknown), (p,), mean errors of the pairs; ``seconds`` of the run.
    """
    settings = cell.settings
    maps = map_set(cell.data, settings["set"])
    rng = np.random.default_rng(settings["seed"])
    with tempfile.TemporaryDirectory() as folder:
        for name in settings["names"]:
            shape = maps.data.shape(name)
            posed = shape.vertices @ random_rotation(rng).T
            write_mesh(Path(folder) / f"{name}.ply", Shape.from_arrays(posed, shape.faces))
        started = time.process_time()
        found = align_collection(
            folder,
            options=AlignOptions(deformable=True),
            run=RunOptions(jobs=1, store=Path(folder) / "x.sqlite"),
        ).vertex_maps
        seconds = time.process_time() - started
    errors, mirrored = [], []
    for target, source in settings["pairs"]:
        truth, flipped = true_places(maps, target, maps.landmarks(target), None)
        evaluator = MapEvaluator(maps.data.shape(target), truth, flipped)
        of_pair = evaluator.errors(found[target, source][maps.landmarks(source)])
        errors.append(of_pair.direct.mean())
        mirrored.append(np.nan if of_pair.mirrored is None else of_pair.mirrored.mean())
    return {"errors": np.array(errors), "mirrored": np.array(mirrored), "seconds": seconds}


def weighed(
    target: SpectralShape, source: SpectralShape, found: list[Refined], at: IntArray
) -> Record:
    """Return what confidences weigh of all candidates, and of their points at dense samples of the source, (s,)."""
    numbers = range(len(found))
    return {
        "scores": np.array([one.score for one in found]),
        "evidence": np.array([astuple(one.evidence) for one in found]),
        "standing": np.array([standing(target, found, number) for number in numbers]),
        "points": np.stack([point_terms(target, source, found, number)[at] for number in numbers]),
    }


def images_of(candidate: Refined, target: SpectralShape, source: SpectralShape) -> IntArray:
    """Return the vertex of the target's file for each of the source's by a map of dense samples."""
    samples = target.dense[candidate.functional_map.map_target_source]
    return in_files(samples[source.nearest_dense], target, source)


def terms_of(record: Record) -> FloatArray:
    """Return what :func:`~collalign.confidence.map_model.map_probability` weighs of each candidate, shape (m, t)."""
    return np.stack(
        [
            map_terms(
                float(own[0]), float(own[1]), Evidence(**dict(zip(EVIDENCE, seen, strict=True)))
            )
            for own, seen in zip(record["standing"], record["evidence"], strict=True)
        ]
    )


def row_of(name: str, records: list[Record]) -> Row:
    """Return the row of one set."""
    error, mirrored = (
        np.array([record[key] for record in records]) for key in ("error", "mirrored")
    )
    sure = np.array([map_probability(terms_of(r)[0], knows_sides=True) for r in records])
    stated = sure >= SURE
    return {
        "set": name,
        "pairs": len(records),
        "mean": float(error.mean()),
        "median": float(np.median(error)),
        "flipped": 100.0 * float((mirrored < error).mean()),
        "found": 100.0 * float(np.mean([r["candidates"].min() < FOUND_MEAN for r in records])),
        "sure": int(stated.sum()),
        "right": 100.0 * float((error[stated] < NEAR).mean()) if stated.any() else None,
        "seconds": float(np.median([record["seconds"] for record in records])),
    }


COLUMNS = (
    Column(key="set", title="set"),
    Column(key="pairs", title="pairs"),
    Column(key="mean", title="mean error", format=".3f"),
    Column(key="median", title="median pair", format=".3f"),
    Column(key="flipped", title="flipped, %", format=".0f"),
    Column(key="found", title="right map among the candidates, %", format=".0f"),
    Column(key="sure", title="sure maps"),
    Column(key="right", title="of these right, %", format=".0f"),
    Column(key="seconds", title="CPU, s a pair", format=".1f", clock=True),
)


def measured_pairs(bench: Bench, name: str, num: int) -> list[Record]:
    """Return what :func:`measure_body_map` finds of at most so many pairs of a set of maps, drawn at random."""
    return _measured(bench, name, some_pairs(read_map_set(bench.data, name).pairs, num, SEED))


def _measured(bench: Bench, name: str, pairs: tuple[Pair, ...]) -> list[Record]:
    surface: dict[str, Any] = QUICK_SURFACE if bench.quick else {}
    common = {"set": name, "points": NUM_EVALUATED, "surface": surface}
    cells = {
        f"{name}: {target} {source}": common | {"target": target, "source": source}
        for target, source in pairs
    }
    return list(bench.measure(measure_body_map, cells, version=VERSION).values())


def drawn_kinds(kinds: dict[str, tuple[str, ...]], numbers: dict[str, int]) -> dict[str, str]:
    """Return so many shapes of each kind, drawn at random, with their kinds."""
    rng = np.random.default_rng(SEED)
    return {
        str(name): kind
        for kind, num in numbers.items()
        for name in rng.permutation(kinds[kind])[:num]
    }


def mixed_row(bench: Bench, name: str, numbers: dict[str, int]) -> Row:
    """Return the row of one folder of several kinds."""
    drawn = drawn_kinds(kinds_of(read_map_set(bench.data, name)), numbers)
    pairs = tuple(pair for pair in combinations(drawn, 2) if drawn[pair[0]] != drawn[pair[1]])
    settings = {"set": name, "names": list(drawn), "pairs": pairs, "seed": SEED}
    label = ", ".join(f"{num} {kind}" for kind, num in numbers.items())
    cells = {f"{name}: {label}": settings}
    (whole,) = bench.measure(measure_folder, cells, version=MIXED_VERSION).values()
    alone = _measured(bench, name, pairs)
    errors = np.array([[one["error"], one["mirrored"]] for one in alone]).T
    return {
        "set": f"{name}: {label}",
        "pairs": len(pairs),
        "alone": float(errors[0].mean()),
        "flipped_alone": 100.0 * float((errors[1] < errors[0]).mean()),
        "folder": float(whole["errors"].mean()),
        "flipped": 100.0 * float((whole["mirrored"] < whole["errors"]).mean()),
        "seconds": whole["seconds"],
    }


MIXED_COLUMNS = (
    Column(key="set", title="folder"),
    Column(key="pairs", title="pairs of two kinds"),
    Column(key="alone", title="alone: mean error", format=".3f"),
    Column(key="flipped_alone", title="flipped, %", format=".0f"),
    Column(key="folder", title="in the folder: mean error", format=".3f"),
    Column(key="flipped", title="flipped, %", format=".0f"),
    Column(key="seconds", title="CPU time of the folder, s", format=".0f", clock=True),
)


def measure(bench: Bench) -> Outcome:
    """Map the pairs of all sets, and folders of them; with ``--quick`` one pair of generated bodies."""
    bench.seeds.add(SEED)
    sets = {BIPEDS: 1} if bench.quick else SETS
    rows = [row_of(name, measured_pairs(bench, name, num)) for name, num in sets.items()]
    mixed = {} if bench.quick else MIXED
    folders = tuple(mixed_row(bench, name, numbers) for name, numbers in mixed.items())
    mixed_table = Table(name="folders", columns=MIXED_COLUMNS, rows=folders)
    return Outcome(
        tables=(Table(columns=COLUMNS, rows=tuple(rows)), *((mixed_table,) if folders else ()))
    )


EXPERIMENT = Experiment(
    name="bodies",
    title="Maps between bodies of different kinds: front and back",
    about=_ABOUT,
    measure=measure,
    seen=("shrec07", "scape"),
    collections=("shrec07_dev", FOLDERS[ANIMALS], FOLDERS["scape"], FOLDERS["tosca"]),
)
