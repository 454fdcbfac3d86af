"""The thresholds by which a shape is incomplete, on collections some of whose members were cut."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from collalign.align import align_collection
from collalign.confidence import incomplete_model
from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from collalign.options import AlignOptions
from collalign.output.collection import Collection
from collalign.products.shapes import Shapes
from collalign.stages.incomplete import detect, posed_points
from collalign.stages.shape_stage import prepare_shapes
from data_tools.arrays import BoolArray
from data_tools.io.objects import list_shapes
from data_tools.io.shapes import write_mesh
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from experiments.calibration.scan import Calibration, Constant, Finding, constants_of, patched, scan
from experiments.collections.landmarked import read_dataset
from experiments.pairs.incomplete import without_share

#: Shapes of each collection at the most, which part of them is cut, and how much of these.
NUM_SHAPES, NUM_QUICK, CUT, SHARE = 20, 6, 0.3, 0.25


@dataclass(frozen=True, kw_only=True, eq=False)
class Spoiled:
    """A collection aligned as if all its shapes were complete."""

    shapes: Shapes
    aligned: Collection
    cut: BoolArray


def spoil(data: Path, collection: str, folder: Path, quick: bool) -> Spoiled:
    """Cut a part off some shapes, turn all at random, and align them; the shapes are those at even positions."""
    rng = np.random.default_rng(0)
    dataset = read_dataset(collection, data)
    eligible = (
        np.arange(len(dataset))
        if dataset.chirality is None
        else np.flatnonzero(dataset.chirality == 1)
    )
    chosen = rng.permutation(eligible[::2])[: NUM_QUICK if quick else NUM_SHAPES].tolist()
    cut = {dataset.names[which] for which in chosen[: round(CUT * len(chosen))]}
    for which in chosen:
        shape, rotation = dataset.shape(which), random_rotation(rng)
        if shape.name in cut:
            shape = without_share(shape, rng.standard_normal(3), SHARE)
        write_mesh(
            folder / f"{shape.name}.ply",
            Shape.from_arrays(shape.vertices @ rotation.T, shape.faces, name=shape.name),
        )
    options = AlignOptions(group="SO", incomplete="never")
    aligned = align_collection(folder, options=options, run=RunOptions(jobs=1), progress=False)
    with Session.open(options, RunOptions(jobs=1), None) as session:
        shapes = prepare_shapes(session, list_shapes(folder))
    return Spoiled(
        shapes=shapes, aligned=aligned, cut=np.array([name in cut for name in aligned.names])
    )


def measure_detection(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Look for the cut shapes with other thresholds."""
    with ExitStack() as stack:
        folders = {
            one: Path(stack.enter_context(tempfile.TemporaryDirectory())) for one in collections
        }
        spoiled = {one: spoil(data, one, folder, quick) for one, folder in folders.items()}

        def score(collection: str, changed: Mapping[str, Constant]) -> float:
            tried = spoiled[collection]
            with ExitStack() as stack:
                for module in (detect, posed_points):
                    own = {name: value for name, value in changed.items() if name in vars(module)}
                    stack.enter_context(patched(module, own))
                session = stack.enter_context(
                    Session.open(AlignOptions(group="SO"), RunOptions(jobs=1))
                )
                found = detect.find_incomplete(
                    session, tried.shapes, tried.aligned.pairs, tried.aligned.transforms
                )
            return float((np.isin(np.arange(len(tried.cut)), list(found)) == tried.cut).mean())

        return scan(CALIBRATION.constants, collections, score, quick=quick)


CALIBRATION = Calibration(
    module=incomplete_model.__name__,
    constants=constants_of(incomplete_model, "MISSING_SHARE", "BEYOND"),
    measure=measure_detection,
    collections=("teeth", "mouse skulls", "chair", "fish"),
    score=f"share of shapes judged rightly, {SHARE:.0%} cut off {CUT:.0%} of them",
)
