"""Two-way partial matching of range scans that overlap, against their known poses."""

from __future__ import annotations

import itertools
import time
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from collalign.engine.store.records import Record
from data_tools.arrays import FloatArray
from data_tools.datasets.public import Dataset, read_range_scans
from data_tools.embedding.embedding import Samples, sample_shape
from data_tools.errors import InputError
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.rotations import random_rotation, rotation_angle_deg
from experiments.collections.landmarked import RIGHT_DEG
from experiments.experiment import Bench, Cell, Experiment, Outcome
from experiments.tables import Column, Row, Table
from pairwise.dense.points import DensePoints
from pairwise.matching import match_problem
from pairwise.options import MatchOptions
from pairwise.problem.problem import Problem

SEED = 0
FOLDER = "stanford_bunny_scans"
#: Scans that share less than this of their points are not matched.
MIN_OVERLAP = 0.3
POINTS = (64, 120)
NUM_DENSE = 400

_ABOUT = f"""
Every two range scans of the Stanford bunny that share at least {100 * MIN_OVERLAP:.0f} % of their dense samples at
the published poses, each source in a random pose. Positions alone; what leaving a sample out costs is the squared
spacing of the target's samples; a shift is estimated with the rotation, and the scale is known. *Samples*: the pose
of least energy. *Dense*: the pose that is best by both energies after the stage on {NUM_DENSE} dense points, refined
there. *Candidates*: the best one of all, by samples. The relaxation's bound is valid in partial matching but says
little, so none is given.
"""


def measure_scans(cell: Cell) -> Record:
    """Match all overlapping pairs; one entry per pair."""
    settings = cell.settings
    dataset = read_range_scans(cell.data / FOLDER)
    sampling = SamplingOptions(
        num_points=settings["points"], metric="euclidean", normalisation="none", num_dense_points=settings["dense"]
    )
    chosen = range(min(settings["scans"], len(dataset)))
    samples = [sample_shape(dataset.shape(i), sampling, EmbeddingOptions(kind="xyz")) for i in chosen]
    rng = np.random.default_rng(settings["seed"])
    found: dict[str, list[Any]] = {
        key: [] for key in ("target", "source", "overlap", "best", "dense", "top", "seconds")
    }
    for i, j in itertools.combinations(chosen, 2):
        turn = random_rotation(rng)
        overlap = overlap_share(dataset, samples, i, j)
        if overlap < MIN_OVERLAP:
            continue
        errors = _match(samples[i], samples[j], dataset.rotation(i, j), turn)
        for key, value in {
            "target": dataset.names[i],
            "source": dataset.names[j],
            "overlap": overlap,
            **errors,
        }.items():
            found[key].append(value)
    return found


def _match(target: Samples, source: Samples, truth: FloatArray, turn: FloatArray) -> dict[str, float]:
    """Return the errors in degrees, and the processor time."""
    spacing = np.median(cKDTree(target.positions).query(target.positions, k=2)[0][:, 1])
    problem = Problem.from_user(target.positions, source.positions @ turn.T, unmatched_penalty=float(spacing**2))
    dense = tuple(DensePoints.from_user(p) for p in (target.dense_positions, source.dense_positions @ turn.T))
    begin = time.process_time()
    result = match_problem(problem, MatchOptions(estimate_translation=True), dense=(dense[0], dense[1]))
    seconds = time.process_time() - begin
    ranked = sorted(result.candidates, key=lambda candidate: candidate.energy)
    errors = rotation_angle_deg(np.stack([c.R_target_source for c in ranked]), truth @ turn.T)
    refined = float("nan") if result.refined is None else result.refined.pose.rotation
    return {
        "best": float(errors[0]),
        "top": float(errors.min()),
        "dense": float(rotation_angle_deg(refined, truth @ turn.T)),
        "seconds": seconds,
    }


def overlap_share(dataset: Dataset, samples: list[Samples], i: int, j: int) -> float:
    """Return the share of the dense samples of both scans with a counterpart in the other, at the known poses."""
    if dataset.rotations is None or dataset.translations is None:
        raise InputError(f"{FOLDER}: the poses of the scans are not known")
    clouds = [
        (samples[s].dense_positions * samples[s].scale + samples[s].offset) @ dataset.rotations[s].T
        + dataset.translations[s]
        for s in (i, j)
    ]
    spacing = np.median(cKDTree(clouds[0]).query(clouds[0], k=2)[0][:, 1])
    near = [cKDTree(a).query(b)[0] <= spacing for a, b in (clouds, clouds[::-1])]
    return float(np.concatenate(near).mean())


def scan_rows(points: int, record: Record) -> list[Row]:
    """Return one row per pair."""
    return [
        {
            "points": points,
            "target": record["target"][p],
            "source": record["source"][p],
            "overlap": 100.0 * record["overlap"][p],
            "best": record["best"][p],
            "dense": record["dense"][p],
            "top": record["top"][p],
            "seconds": record["seconds"][p],
        }
        for p in range(len(record["overlap"]))
    ]


def summary_rows(points: int, record: Record) -> list[Row]:
    """Return the shares of right pairs by their overlap."""
    overlap = 100.0 * np.array(record["overlap"])
    rows: list[Row] = []
    for low, high in ((30, 50), (50, 70), (70, 100)):
        chosen = (overlap >= low) & (overlap <= high if high == 100 else overlap < high)
        if not chosen.any():
            continue
        shares = {
            key: 100.0 * float(np.mean(np.array(record[key])[chosen] <= RIGHT_DEG))
            for key in ("best", "dense", "top")
        }
        median = float(np.median(np.array(record["dense"])[chosen]))
        rows.append(
            {
                "points": points,
                "overlap": f"{low} to {high}",
                "pairs": int(chosen.sum()),
                **shares,
                "median": median,
            }
        )
    return rows


_PAIR_COLUMNS = (
    Column(key="points", title="k"),
    Column(key="target", title="target"),
    Column(key="source", title="source"),
    Column(key="overlap", title="overlap, %", format=".0f"),
    Column(key="best", title="samples, deg", format=".1f"),
    Column(key="dense", title="dense, deg", format=".1f"),
    Column(key="top", title="best candidate, deg", format=".1f"),
    Column(key="seconds", title="s", format=".1f", clock=True),
)
_SUMMARY_COLUMNS = (
    Column(key="points", title="k"),
    Column(key="overlap", title="overlap, %"),
    Column(key="pairs", title="pairs"),
    Column(key="best", title="samples right, %", format=".0f"),
    Column(key="dense", title="dense right, %", format=".0f"),
    Column(key="top", title="candidates, %", format=".0f"),
    Column(key="median", title="median error, dense, deg", format=".1f"),
)


def measure(bench: Bench) -> Outcome:
    """Match the scans with each number of samples."""
    bench.seeds.add(SEED)
    settings = {
        f"k={points}": {
            "points": points,
            "scans": 3 if bench.quick else 10,
            "dense": NUM_DENSE,
            "seed": SEED,
        }
        for points in (POINTS[:1] if bench.quick else POINTS)
    }
    records = bench.measure(measure_scans, settings, version="2")
    named = [(settings[label]["points"], record) for label, record in records.items()]
    return Outcome(
        tables=(
            Table(
                caption=f"Right: within {RIGHT_DEG:.0f} degrees of the known rotation.",
                columns=_SUMMARY_COLUMNS,
                rows=tuple(row for points, record in named for row in summary_rows(points, record)),
            ),
            Table(
                name="pairs",
                caption="Every pair.",
                columns=_PAIR_COLUMNS,
                rows=tuple(row for points, record in named for row in scan_rows(points, record)),
            ),
        )
    )


EXPERIMENT = Experiment(
    name="partial_scans",
    title="Range scans that overlap in part",
    about=_ABOUT,
    measure=measure,
    collections=(FOLDER,),
)
