"""Cells that align a public collection from random poses, by default or as published, and count errors."""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from collalign.align import align_collection
from collalign.engine.records import Record
from collalign.engine.run_options import RunOptions
from collalign.options import AlignOptions
from collalign.output.collection import Collection
from collalign.products.trust import DOUBT
from data_tools.arrays import FloatArray
from data_tools.errors import InputError
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.rotations import rotation_angle_deg
from experiments.clock import stopwatch
from experiments.collections.landmarked import RIGHT_DEG, TEETH_FOLDER, read_dataset
from experiments.collections.posed import PosedCollection, pose_collection
from experiments.experiment import Cell

#: The published rotations beside the teeth.
PUBLISHED_FILE = "auto3dgm_rotations_baseline.npz"


def pose_some(settings: dict[str, Any], data: Path, folder: Path) -> tuple[PosedCollection, str]:
    """Write some shapes of a collection in random poses.

    Parameters
    ----------
    settings : dict
        ``collection``, ``shapes`` (how many; they and their poses are drawn with ``seed``).
    data, folder : Path

    Returns
    -------
    posed : PosedCollection
    group : {"SO", "O"}
        In which the truth is.
    """
    dataset = read_dataset(settings["collection"], data)
    rng = np.random.default_rng(settings["seed"])
    posed = pose_collection(
        dataset, rng.permutation(len(dataset))[: settings["shapes"]], folder, rng
    )
    return posed, "SO" if dataset.chirality is None else "O"


def toolkit_options(settings: dict[str, Any]) -> AlignOptions:
    """Return the toolkit's default options but for ``points``, ``embedding`` and ``pairs``."""
    return AlignOptions(
        pairs=settings["pairs"],
        sampling=SamplingOptions(num_points=settings["points"]),
        embedding=EmbeddingOptions(kind=settings["embedding"]),
    )


def published_options(settings: dict[str, Any], group: str) -> AlignOptions:
    """Return the options of appendix B as published: PM-SDP with the four starts of appendix A, spectral, no more."""
    paper = AlignOptions(preset="paper", group="O" if group == "O" else "SO")
    return replace(
        paper,
        pairs=settings["pairs"],
        sampling=replace(paper.sampling, num_points=settings["points"]),
        embedding=EmbeddingOptions(kind=settings["embedding"]),
    )


def measure_alignment(cell: Cell) -> Record:
    """Align a collection with ``way`` "toolkit" or "appendix B", and ``subsets`` of six of its shapes as well."""
    settings = cell.settings
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "shapes"
        folder.mkdir()
        posed, group = pose_some(settings, cell.data, folder)
        options = (
            toolkit_options(settings)
            if settings["way"] == "toolkit"
            else published_options(settings, group)
        )
        run = RunOptions(jobs=1, store=Path(name) / "store.sqlite", pair_time_limit_s=3600)
        with stopwatch() as elapsed:
            aligned = align_collection(folder, options=options, run=run)
        record = alignment_record(aligned, posed)
        right = align_subsets(posed, settings, options, run) if settings.get("subsets") else []
    return {**record, "subsets": right, "processor_s": elapsed.processor_s}


def alignment_record(aligned: Collection, posed: PosedCollection) -> Record:
    """Return the errors of an alignment, and of its pairs before synchronization; NaN where chirality is wrong."""
    shapes = posed.shape_errors_deg(aligned.rotations, aligned.names)
    own = candidate_errors_deg(aligned, posed)
    sure = ~(aligned.confidence < DOUBT)
    return {
        **posed.figures(aligned.rotations, aligned.names),
        "group": aligned.group,
        "matched": len(own),
        "own_deg": own[:, 0],
        "candidate_deg": own[:, 1],
        "pair_deg": posed.pair_errors_deg(aligned.rotations, aligned.names),
        "shape_deg": shapes,
        "unnoticed": int((sure & (shapes > RIGHT_DEG)).sum()),
    }


def candidate_errors_deg(aligned: Collection, posed: PosedCollection) -> FloatArray:
    """Return the errors of each pair's best pose and of its best candidate, shape (E, 2); NaN where mirrored."""
    index = [posed.names.index(name) for name in aligned.names]
    errors = np.full((len(aligned.pairs), 2), np.nan)
    for row, pair in enumerate(aligned.pairs):
        true = posed.relative[index[pair.target], index[pair.source]]
        found = rotation_angle_deg(
            pair.rotations[:, :3, :3], np.tile(true, (len(pair.rotations), 1, 1))
        )
        errors[row] = found[0], np.nan if np.isnan(found).all() else np.nanmin(found)
    return errors


def align_subsets(
    posed: PosedCollection, settings: dict[str, Any], options: AlignOptions, run: RunOptions
) -> list[float]:
    """Align random subsets of ``subset_size`` shapes and return the share of each that is right.

    The pairs come out of the run's store, where the whole collection was aligned before.
    """
    rng = np.random.default_rng(settings["seed"])
    files = {file.stem: file for file in posed.folder.iterdir()}
    shares = []
    for _ in range(settings["subsets"]):
        chosen = rng.choice(len(posed.names), settings["subset_size"], replace=False)
        with tempfile.TemporaryDirectory() as folder:
            for which in chosen:
                shutil.copy(files[posed.names[which]], folder)
            aligned = align_collection(folder, options=options, run=run)
        shares.append(
            float((posed.shape_errors_deg(aligned.rotations, aligned.names) <= RIGHT_DEG).mean())
        )
    return shares


def measure_published_rotations(cell: Cell) -> Record:
    """Compare auto3dgm's published rotations of the teeth, for those that have one, with the landmarks."""
    dataset = read_dataset("teeth", cell.data)
    file = cell.data / TEETH_FOLDER / PUBLISHED_FILE
    with np.load(file, allow_pickle=False) as archive:
        found = dict(zip(archive["names"].tolist(), archive["R"], strict=True))
    missing = set(dataset.names) - set(found)
    if missing:
        raise InputError(f"{file}: no entry for {sorted(missing)[0]}")
    names = tuple(name for name in dataset.names if np.isfinite(found[name]).all())
    which = [dataset.index(name) for name in names]
    true = np.array([[dataset.rotation(a, b, group="O") for b in which] for a in which])
    posed = PosedCollection(folder=cell.data / TEETH_FOLDER, names=names, relative=true)
    rotations = np.stack([found[name] for name in names])
    return {
        **posed.figures(rotations, names),
        "pair_deg": posed.pair_errors_deg(rotations, names),
        "shape_deg": posed.shape_errors_deg(rotations, names),
    }
