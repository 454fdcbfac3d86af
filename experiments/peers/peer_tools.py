"""The tools that are compared, each from a folder of files to one rotation per shape, and the packages they need."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from collalign import AlignOptions, RunOptions, align_collection
from data_tools.arrays import FloatArray
from data_tools.io.listing import read_folder
from data_tools.io.shapes import read_shape
from data_tools.surface.shape import Shape
from experiments.clock import Elapsed, stopwatch
from experiments.importable import is_importable
from experiments.peers.peer_pairs import (
    MatchedPairs,
    drift_pairs,
    kiss_pairs,
    of_one_size,
    open3d_pairs,
    open3d_pose_graph,
    spectral,
)
from experiments.peers.principal_axes import align_by_principal_axes


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer:
    """What a tool made of a collection.

    Attributes
    ----------
    names : tuple of str
        Shapes that it aligned.
    rotations : ndarray, shape (N, 3, 3)
        ``R_common_shape``.
    elapsed : Elapsed
        From the files to the rotations.
    confidence : ndarray, shape (N,), or None
        Of each shape's rotation, where the tool states one.
    """

    names: tuple[str, ...]
    rotations: FloatArray
    elapsed: Elapsed
    confidence: FloatArray | None = None


#: Aligns the files of a folder, where mirror images may be allowed; an answer for each way to synchronize its pairs.
Align: TypeAlias = Callable[[Path, bool, int], dict[str, Answer]]


@dataclass(frozen=True, kw_only=True)
class Tool:
    """A tool of the comparison.

    Attributes
    ----------
    align : callable
        Takes the folder, whether the collection mixes mirror images, and the number of processes or threads.
    answers : tuple of str
        Names of its answers.
    packages : tuple of str
        Modules that it imports.
    """

    align: Align
    answers: tuple[str, ...]
    packages: tuple[str, ...] = ()

    def lacks(self) -> str:
        """Return the packages that cannot be imported, separated by commas."""
        return ", ".join(name for name in self.packages if not is_importable(name))


def _collalign(folder: Path, mixed: bool, num_jobs: int) -> dict[str, Answer]:
    with stopwatch() as elapsed:
        found = align_collection(folder, options=AlignOptions(), run=RunOptions(jobs=num_jobs))
    answer = Answer(
        names=found.names, rotations=found.rotations, elapsed=elapsed, confidence=found.confidence
    )
    return {"collalign": answer}


def _principal_axes(folder: Path, mixed: bool, num_jobs: int) -> dict[str, Answer]:
    with stopwatch() as elapsed:
        shapes = _read(folder)
        rotations = align_by_principal_axes(shapes, group="O" if mixed else "SO", num_jobs=num_jobs)
    return {
        "principal axes + ICP + tree": Answer(
            names=_names(shapes), rotations=rotations, elapsed=elapsed
        )
    }


def _from_pairs(
    match: Callable[[Sequence[Shape], int], MatchedPairs],
    synchronizers: Mapping[str, Callable[[MatchedPairs], FloatArray]],
) -> Align:
    """Return a tool that matches all pairs once and synchronizes them in one or more ways."""

    def align(folder: Path, mixed: bool, num_jobs: int) -> dict[str, Answer]:
        with stopwatch() as matching:
            shapes = [of_one_size(shape) for shape in _read(folder)]
            pairs = match(shapes, num_jobs)
        answers = {}
        for name, synchronizer in synchronizers.items():
            with stopwatch() as rest:
                rotations = synchronizer(pairs)
            elapsed = Elapsed(
                wall_s=matching.wall_s + rest.wall_s,
                processor_s=matching.processor_s + rest.processor_s,
            )
            answers[name] = Answer(names=_names(shapes), rotations=rotations, elapsed=elapsed)
        return answers

    return align


def _read(folder: Path) -> list[Shape]:
    return [read_shape(file) for file in read_folder(folder).files]


def _names(shapes: Sequence[Shape]) -> tuple[str, ...]:
    return tuple(shape.name for shape in shapes)


_OPEN3D = {"Open3D pairs + pose graph": open3d_pose_graph, "Open3D pairs + spectral": spectral}
_KISS = {"KISS-Matcher + GICP + spectral": spectral}
_DRIFT = {"principal axes + CPD + spectral": spectral}

TOOLS: dict[str, Tool] = {
    "collalign": Tool(align=_collalign, answers=("collalign",)),
    "open3d": Tool(
        align=_from_pairs(open3d_pairs, _OPEN3D), answers=tuple(_OPEN3D), packages=("open3d",)
    ),
    "axes": Tool(align=_principal_axes, answers=("principal axes + ICP + tree",)),
    "kiss": Tool(
        align=_from_pairs(kiss_pairs, _KISS),
        answers=tuple(_KISS),
        packages=("kiss_matcher", "small_gicp"),
    ),
    "drift": Tool(
        align=_from_pairs(drift_pairs, _DRIFT), answers=tuple(_DRIFT), packages=("rustcpd",)
    ),
}
