"""Random sub-collections, each aligned on its own: what was stated about every shape, and what was true."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from collalign import AlignOptions, RunOptions, align_collection
from collalign.engine.records import Record
from collalign.output.collection import Collection
from collalign.products.trust import DOUBT, KINDS
from data_tools.io.shapes import write_mesh
from experiments.collections.landmarked import RIGHT_DEG, read_dataset
from experiments.collections.posed import PosedCollection, pose_collection
from experiments.confidence.families import FAMILIES, noise_cloud, pose_family
from experiments.experiment import Cell

#: Shapes of a run, drawn uniformly in the logarithm.
FEWEST, MOST = 2, 12
#: Of the runs this part has one shape replaced by an intruder, where there are more than so few shapes.
INTRUDED, FEWEST_INTRUDED = 0.25, 4
INTRUDER = "intruder"
#: Sub-collections are wrong without a word where a shape is this far off and nothing is said of it.
GROSS_DEG = 30.0


def measure_run(cell: Cell) -> Record:
    """Align one random sub-collection of a collection, or one generated collection.

    Settings: ``kind`` (a real collection or a generated family), ``seed``, ``run`` (its number).

    Returns
    -------
    dict
        One array per fact, over the shapes of the run: ``run``, ``stated`` confidence, ``error_deg``, ``right``,
        ``intruder``, ``named`` (in doubt, or named by a note); and ``evidence``, one row per shape.
    """
    kind, run = cell.settings["kind"], cell.settings["run"]
    rng = np.random.default_rng([cell.settings["seed"], run, *kind.encode()])
    with tempfile.TemporaryDirectory() as name:
        posed = _drawn(kind, cell.data, Path(name), rng)
        aligned = align_collection(name, options=AlignOptions(), run=RunOptions(jobs=1))
    facts = [{"run": run, **fact} for fact in shape_facts(aligned, posed, kind)]
    return {key: np.array([fact[key] for fact in facts]) for key in facts[0]}


def measure_runs(
    measure: Callable[[dict[str, dict[str, Any]]], Mapping[str, Record]],
    num_runs: Mapping[str, int],
    seed: int,
) -> dict[str, Record]:
    """Measure so many runs of each kind, and return one record for each kind.

    Parameters
    ----------
    measure : callable
        From the settings of :func:`measure_run`, by label, to its records.
    num_runs : mapping of str to int
    seed : int
    """
    cells = {
        f"{kind}, run {run}": {"kind": kind, "seed": seed, "run": run}
        for kind, num in num_runs.items()
        for run in range(num)
    }
    found = measure(cells)
    of_kinds = {
        kind: [found[label] for label, settings in cells.items() if settings["kind"] == kind]
        for kind in num_runs
    }
    return {
        kind: {key: np.concatenate([run[key] for run in runs]) for key in runs[0]}
        for kind, runs in of_kinds.items()
    }


def shape_facts(aligned: Collection, posed: PosedCollection, kind: str) -> list[dict[str, Any]]:
    """Return what was stated and what is true of every shape of a run."""
    trust = aligned.made.trust
    # Shapes that are joined as scans are not judged by this evidence.
    unknown = np.full((len(aligned.names), len(KINDS)), np.nan)
    evidence = unknown if trust is None else trust.evidence
    known = [index for index, name in enumerate(aligned.names) if name in posed.names]
    errors = np.full(len(aligned.names), np.nan)
    if kind not in FAMILIES or FAMILIES[kind].related:
        for part in _parts(aligned, known):
            errors[part] = posed.shape_errors_deg(
                aligned.rotations[part], [aligned.names[i] for i in part]
            )
    noted = {name for note in aligned.notes for name in note.shapes}
    return [
        {
            "stated": float(aligned.confidence[i]),
            "evidence": evidence[i],
            "error_deg": float(errors[i]),
            "right": bool(errors[i] <= RIGHT_DEG),
            "intruder": i not in known,
            "named": bool(aligned.confidence[i] < DOUBT or name in noted),
        }
        for i, name in enumerate(aligned.names)
    ]


def _parts(aligned: Collection, known: list[int]) -> list[list[int]]:
    """Return the shapes whose poses can be compared: of one part of two or more, and in a mixture of one name."""
    sizes = np.bincount(aligned.part_numbers)
    stems = {i: aligned.names[i].rstrip("0123456789") for i in known}
    is_mixture = set(stems.values()) == {"chair", "figure"}
    found: dict[tuple[int, str], list[int]] = {}
    for i in known:
        part = int(aligned.part_numbers[i])
        if sizes[part] > 1:
            found.setdefault((part, stems[i] if is_mixture else ""), []).append(i)
    return list(found.values())


def _drawn(kind: str, data: Path, folder: Path, rng: np.random.Generator) -> PosedCollection:
    """Write the shapes of a run in random poses, one of them perhaps replaced by an intruder."""
    dataset = None if kind in FAMILIES else read_dataset(kind, data)
    num = int(np.round(np.exp(rng.uniform(np.log(FEWEST), np.log(MOST)))))
    num = num if dataset is None else min(num, len(dataset))
    is_related = dataset is not None or FAMILIES[kind].related
    if is_related and num >= FEWEST_INTRUDED and rng.random() < INTRUDED:
        _write_intruder(folder, rng)
        num -= 1
    if dataset is None:
        return pose_family(FAMILIES[kind], num, folder, rng)
    return pose_collection(dataset, rng.choice(len(dataset), num, replace=False), folder, rng)


def _write_intruder(folder: Path, rng: np.random.Generator) -> None:
    """Write a generated shape, or a cloud of noise, among the shapes of a run."""
    kinds = ("crowns", "chairs", "bent figures", "unrelated blobs")
    which = int(rng.integers(len(kinds) + 1))
    shape = noise_cloud(rng) if which == len(kinds) else FAMILIES[kinds[which]].members(1, rng)[0]
    write_mesh(folder / f"{INTRUDER}.ply", shape)
