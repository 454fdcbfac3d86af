"""Random sub-collections, each aligned on its own: what was stated about every shape, and what was true."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from collalign import AlignOptions, RunOptions, align_collection
from collalign.engine.store.records import Record
from collalign.output.collection import Collection
from collalign.products.trust import DOUBT
from data_tools.io.shapes import write_mesh
from experiments.collections.landmarked import COLLECTIONS, RIGHT_DEG, read_dataset
from experiments.collections.posed import PosedCollection, pose_collection
from experiments.confidence.families import FAMILIES, noise_cloud, pose_family
from experiments.experiment import Cell

#: Shapes of a run, drawn uniformly in the logarithm; of a collection at most the larger are posed.
FEWEST, MOST = 2, 40
#: Of the runs this part has one shape replaced by an intruder, where there are more than so few shapes.
INTRUDED, FEWEST_INTRUDED = 0.25, 4
INTRUDER = "intruder"
#: Sub-collections are wrong without a word where a shape is this far off and nothing is said of it.
GROSS_DEG = 30.0


def measure_collection(cell: Cell) -> Record:
    """Align random sub-collections of one collection, or generated collections of one kind.

    Settings: ``kind`` (a real collection or a generated family), ``seed``, ``runs``.

    Returns
    -------
    dict
        One array per fact, over the shapes of all runs: ``run``, ``stated`` confidence, ``error_deg``, ``right``,
        ``intruder``, ``named`` (in doubt, or named by a note); and ``evidence``, one row per shape.
    """
    settings = cell.settings
    rng = np.random.default_rng(settings["seed"])
    facts: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        whole = None if settings["kind"] in FAMILIES else _posed(settings["kind"], cell.data, root)
        for run in range(settings["runs"]):
            folder = root / f"run{run}"
            folder.mkdir()
            posed = (
                _generated(settings["kind"], folder, rng)
                if whole is None
                else _subset(whole, folder, rng)
            )
            aligned = align_collection(
                folder, options=AlignOptions(), run=RunOptions(jobs=1, store=root / "store.sqlite")
            )
            facts += [
                {"run": run, **fact} for fact in shape_facts(aligned, posed, settings["kind"])
            ]
            shutil.rmtree(folder)
    return {key: np.array([fact[key] for fact in facts]) for key in facts[0]}


def shape_facts(aligned: Collection, posed: PosedCollection, kind: str) -> list[dict[str, Any]]:
    """Return what was stated and what is true of every shape of a run."""
    assert aligned.made.trust is not None  # the robust synchronization always gathers it
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
            "evidence": aligned.made.trust.evidence[i],
            "error_deg": float(errors[i]),
            "right": bool(errors[i] <= RIGHT_DEG),
            "intruder": i not in known,
            "named": bool(aligned.confidence[i] < DOUBT or name in noted),
        }
        for i, name in enumerate(aligned.names)
    ]


def _parts(aligned: Collection, known: list[int]) -> list[list[int]]:
    """Return the shapes whose poses can be compared: those of one name but for its digits, or all."""
    stems = {aligned.names[i].rstrip("0123456789") for i in known}
    if stems != {"chair", "figure"}:
        return [known]
    return [[i for i in known if aligned.names[i].startswith(stem)] for stem in sorted(stems)]


def _size(rng: np.random.Generator) -> int:
    return int(np.round(np.exp(rng.uniform(np.log(FEWEST), np.log(MOST)))))


def _generated(kind: str, folder: Path, rng: np.random.Generator) -> PosedCollection:
    """Write a generated collection, of at most half as many shapes: nothing of it can be matched twice."""
    num = min(_size(rng), MOST // 2)
    if FAMILIES[kind].related and num >= FEWEST_INTRUDED and rng.random() < INTRUDED:
        _write_intruder(folder, rng)
        num -= 1
    return pose_family(FAMILIES[kind], num, folder, rng)


def _subset(whole: PosedCollection, folder: Path, rng: np.random.Generator) -> PosedCollection:
    """Copy some shapes of a posed collection, one of them perhaps replaced by an intruder."""
    chosen = np.sort(rng.choice(len(whole.names), min(_size(rng), len(whole.names)), replace=False))
    if len(chosen) >= FEWEST_INTRUDED and rng.random() < INTRUDED:
        _write_intruder(folder, rng)
        chosen = chosen[1:]
    for index in chosen:
        shutil.copy(whole.folder / f"{whole.names[index]}.ply", folder)
    return whole


def _posed(kind: str, data: Path, root: Path) -> PosedCollection:
    """Pose up to :data:`MOST` shapes of a real collection, the same for every run: their pairs are matched once."""
    dataset = read_dataset(kind, data)
    rng = np.random.default_rng(COLLECTIONS.index(kind))
    chosen = rng.permutation(len(dataset))[:MOST]
    folder = root / "posed"
    folder.mkdir()
    return pose_collection(dataset, chosen, folder, rng)


def _write_intruder(folder: Path, rng: np.random.Generator) -> None:
    """Write a generated shape, or a cloud of noise, among the shapes of a run."""
    kinds = ("crowns", "chairs", "bent figures", "unrelated blobs")
    which = int(rng.integers(len(kinds) + 1))
    shape = noise_cloud(rng) if which == len(kinds) else FAMILIES[kinds[which]].members(1, rng)[0]
    write_mesh(folder / f"{INTRUDER}.ply", shape)
