"""What every format's writer is given, and what they share: spaces, names, numbers, source meshes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from collalign.analysis.procrustes import MIN_LABELS, common_labels, generalized_procrustes
from collalign.output.collection import Collection
from collalign.output.members import Members
from data_tools.arrays import BoolArray, FloatArray
from data_tools.checks import check_choice
from data_tools.errors import InputError, OptionsError
from data_tools.io.output_folder import OutputFolder
from data_tools.io.shapes import CoordinateSystem, declared_system, read_shape
from data_tools.landmark_files import SemilandmarkRows
from data_tools.notes import Note
from data_tools.poses import each_moved_by
from data_tools.surface.shape import Shape

Space = Literal["aligned", "unscaled", "raw", "procrustes"]


@dataclass(frozen=True, kw_only=True)
class ExportRequest:
    """What a format of an export is made of.

    Attributes
    ----------
    collection : Collection
    output : OutputFolder
        Where files are staged.
    who : Members
        Whose shapes count in means, distances and superimpositions.
    space : {"aligned", "unscaled", "raw", "procrustes"}
        Coordinates of landmarks and meshes: the common frame; the common frame with every shape in its file's unit;
        the file's own; superimposed on the generalised Procrustes mean (landmarks only).
    semilandmarks : tuple of SemilandmarkRows
        Which landmarks are on curves and patches; Procrustes coordinates, which leave out some, know none.
    system : {"LPS", "RAS"}
        Coordinates of the files that declare none.
    """

    collection: Collection
    output: OutputFolder
    who: Members
    space: Space = "aligned"
    semilandmarks: tuple[SemilandmarkRows, ...] = ()
    system: CoordinateSystem = "LPS"

    def __post_init__(self) -> None:
        """Refuse an unknown space."""
        check_choice("space", self.space, get_args(Space))

    @property
    def counted(self) -> ExportRequest:
        """The same of the shapes alone that count in statistics."""
        names = {name for name, _ in self.who.left_out}
        chosen = [at for at, name in enumerate(self.collection.names) if name not in names]
        return replace(self, collection=self.collection.some(np.array(chosen, dtype=np.int64)))

    def transforms(self) -> FloatArray:
        """Take file coordinates to the space asked for, shape (N, 4, 4).

        Raises
        ------
        OptionsError
            For Procrustes coordinates, which only landmarks have.
        """
        if self.space == "procrustes":
            raise OptionsError(
                "space: Procrustes coordinates exist for landmarks only; choose aligned, unscaled or raw"
            )
        if self.space == "raw":
            return np.tile(np.eye(4), (len(self.collection), 1, 1))
        if self.space == "aligned":
            return self.collection.transforms
        shrink = np.ones((len(self.collection), 4, 4))
        shrink[:, :3] /= self.collection.scales[:, None, None]
        return self.collection.transforms * shrink

    def file_systems(self) -> list[CoordinateSystem]:
        """Return the coordinate system of every original file: what it declares, or :attr:`system`."""
        return [
            (declared_system(Path(file)) if file else None) or self.system
            for file in self.collection.files
        ]

    def landmark_systems(self) -> list[CoordinateSystem]:
        """Return the coordinate system of every shape's landmarks in the space asked for; the common frame is LPS."""
        return self.file_systems() if self.space == "raw" else ["LPS"] * len(self.collection)

    def landmarks(self) -> tuple[tuple[str, ...], FloatArray]:
        """Return names of the landmarks and their coordinates in the space asked for.

        Returns
        -------
        labels : tuple of str
            As the collection calls them; Procrustes coordinates leave out incomplete ones.
        coordinates : ndarray, shape (N, k, 3)
            NaN where a shape has no such landmark.

        Raises
        ------
        InputError
            If too few landmarks are common to all shapes for Procrustes coordinates.
        """
        labels = np.array(self.collection.landmark_names, dtype=object)
        if self.space != "procrustes":
            T = self.transforms()
            moved = each_moved_by(T, self.collection.landmarks)
            return tuple(labels.tolist()), moved
        common = complete_labels(self.collection)
        superimposed = generalized_procrustes(self.collection.aligned_landmarks[:, common])
        return tuple(labels[common].tolist()), superimposed

    def source_shape(self, at: int) -> Shape:
        """Read one original file again, whole.

        Raises
        ------
        InputError
            If it is no longer there.
        """
        path = self.collection.file(at)
        cleaning = replace(
            self.collection.options.cleaning, merge_vertices=True, components="all", inner="keep"
        )
        return read_shape(path, cleaning, name=self.collection.names[at])

    def path(self, name: str) -> Path:
        """Return the path of one file, whose folder exists then; names that would lead elsewhere are refused."""
        return self.output.stage(*name.split("/"))

    def write(self, name: str, text: str) -> Path:
        """Write one text file with Unix line ends and return its path."""
        return self.output.stage_text(text, *name.split("/"))


def coordinates_note(collection: Collection, space: Space) -> Note:
    """Say which coordinates a file for statistics has, whether sides are made alike, and what became of size."""
    kind: str = space
    if space == "raw" and collection.reflected.any():
        kind = "raw-sides"
    if space == "aligned" and collection.options.scaling == "rigid":
        kind = "unscaled"
    numbers = {"num_reflected": int(collection.reflected.sum()), "total": len(collection)}
    return Note(f"coordinates-{kind}", values=numbers)


def specimen_comment(*, space: Space, reflected: bool) -> str:
    """Say in a few words which coordinates one specimen of a file has."""
    frames = {
        "raw": "coordinates of the file",
        "unscaled": "common frame in the unit of the file",
        "aligned": "common frame",
        "procrustes": "superimposed",
    }
    side = (
        "not reflected"
        if space == "raw" or not reflected
        else "reflected to the side of the others"
    )
    return f"{frames[space]}, {side}"


def complete_labels(collection: Collection) -> BoolArray:
    """Return labels that every shape has, shape (k,).

    Raises
    ------
    InputError
        If they are too few to mean anything.
    """
    common = common_labels(collection.landmarks)
    if common.sum() < MIN_LABELS:
        raise InputError(
            f"only {int(common.sum())} landmarks exist on every shape, but this format needs {MIN_LABELS}. "
            "Use a format with missing landmarks (tps, morphologika), or align the incomplete shapes separately"
        )
    return common


def member_columns(request: ExportRequest) -> dict[str, list[Any]]:
    """Return columns that say why a shape does not count in statistics, and what incomplete shapes cover."""
    collection, reasons = request.collection, dict(request.who.left_out)
    columns: dict[str, list[Any]] = {
        "left_out": [reasons.get(name, "") for name in collection.names]
    }
    if collection.incomplete:
        incomplete = collection.is_incomplete.astype(int).tolist()
        columns |= {"incomplete": incomplete, "coverage": collection.coverage.tolist()}
    return columns


def label_columns(collection: Collection, taken: Iterable[str]) -> dict[str, list[str]]:
    """Label columns for a table that has the columns ``taken`` already, which get ``label_`` before their name."""
    fixed = set(taken)
    return {
        f"label_{name}" if name in fixed else name: list(values)
        for name, values in collection.labels.items()
    }


def words(values: Iterable[float]) -> str:
    """Return numbers as exports write them: in full, separated by blanks, without exponents."""
    return " ".join(
        "NaN" if np.isnan(value) else np.format_float_positional(value, trim="0")
        for value in values
    )
