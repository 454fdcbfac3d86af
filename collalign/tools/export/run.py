"""Exports in the formats of the field, one function per format; each writes the whole collection into a folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from collalign.output.collection import Collection
from collalign.output.label_notes import compare_members
from collalign.output.loading import load
from collalign.output.members import LEFT_OUT_FILE, LESS_SURE, Members, statistics_members
from collalign.output.provenance import result_place, write_tool_record
from collalign.tools.export.formats import (
    mesh_writer,
    write_markups,
    write_morphologika,
    write_shapeworks,
    write_tps,
    write_transforms,
)
from collalign.tools.export.request import ExportRequest, Space, coordinates_note
from collalign.tools.export.scans import write_merged, write_meshlab, write_open3d
from collalign.tools.export.tables import write_csv, write_parquet
from collalign.wording import note_text
from data_tools.checks import check_choice
from data_tools.errors import InputError
from data_tools.io.files import read_text, system_reason
from data_tools.io.output_folder import OutputFolder
from data_tools.io.shapes import CoordinateSystem
from data_tools.landmark_files import SemilandmarkRows
from data_tools.names import known_names
from data_tools.notes import Note
from data_tools.threads import one_blas_thread

__all__ = ["FORMATS", "SCANS", "STATISTICS", "Space", "export", "notes_of_export", "usual_space"]

#: Writer of each format.
FORMATS: dict[str, Callable[[ExportRequest], tuple[Path, ...]]] = {
    "morphologika": write_morphologika,
    "tps": write_tps,
    "slicer-json": write_markups,
    "shapeworks": write_shapeworks,
    "csv": write_csv,
    "parquet": write_parquet,
    "ply": mesh_writer("ply"),
    "obj": mesh_writer("obj"),
    "stl": mesh_writer("stl"),
    "itk": write_transforms,
    "open3d": write_open3d,
    "meshlab": write_meshlab,
    "merged": write_merged,
}

#: Formats that statistics read: specimens are reflected and keep their size in them, unless asked otherwise.
STATISTICS = ("morphologika", "tps", "csv", "parquet")
#: Formats of scans: poses that keep the sizes of the files, unless asked otherwise.
SCANS = ("open3d", "meshlab", "merged")
#: From where to where the transforms of a format go.
_DIRECTIONS = {
    "itk": Note("directions-itk"),
    "shapeworks": Note("directions-shapeworks"),
    **dict.fromkeys(("csv", "parquet"), Note("directions-tables")),
}


@one_blas_thread()
def export(
    result: Collection | str | Path,
    format: str,
    to: Path | str,
    *,
    space: Space | None = None,
    sources: Path | str | None = None,
    semilandmarks: tuple[SemilandmarkRows, ...] = (),
    system: CoordinateSystem = "LPS",
    exclude: Sequence[str] = (),
    right: float | None = None,
    include_doubtful: bool = False,
) -> tuple[Path, ...]:
    """Write a collection in one format.

    Parameters
    ----------
    result : Collection or path
        A result, or the folder that ``collalign align`` wrote.
    format : str
        A key of :data:`FORMATS`.
    to : path
        Folder for the files, made if it does not exist; files of an earlier export are replaced, others are not.
    space : {"aligned", "unscaled", "raw", "procrustes"}
        Coordinates of landmarks and meshes; see :class:`~collalign.tools.export.request.ExportRequest`. By default
        formats for statistics (:data:`STATISTICS`) and those of scans (:data:`SCANS`) get "unscaled", reflected and
        of the files' sizes, the others "aligned". A ShapeWorks project always holds raw and aligned coordinates.
    sources : path, optional
        Folder of the original files where they have moved; formats with meshes or points read them.
    semilandmarks : tuple of SemilandmarkRows
        Which landmarks are on curves: Slicer's markups have such a type.
    system : {"LPS", "RAS"}
        Coordinates of the files that declare none, as 3D Slicer's formats say it of raw landmarks.
    exclude : sequence of str
        Names of shapes that are not written, nor count anywhere.
    right : float, optional
        Only the shapes are written that :meth:`~collalign.Collection.select` keeps for this share of right poses.
    include_doubtful : bool
        Superimpose shapes whose pose is in doubt, and incomplete ones, too.

    Returns
    -------
    tuple of Path
        The files written; ``left_out.csv`` is among them where shapes were left out or superimposed.
        Beside them ``notes-FORMAT.txt`` says what a reader must know of the coordinates and of the alignment, and
        ``run-export-FORMAT.json`` is the record of command, version, date and options.

    Raises
    ------
    OptionsError
        If the format or the space is unknown, the format cannot have the space, or the share is none.
    InputError
        If the folder holds no result, no shape is sure enough or counts in a superimposition, an original file is
        missing, or ``to`` cannot be written, holds a shape, lies inside of a folder of theirs, or holds a file of
        others or another command under a name that is to be written.
    """
    check_choice("format", format, FORMATS)
    space = usual_space(format) if space is None else space
    collection = load(result, sources=sources)
    exclude = tuple(known_names("exclude", exclude, collection.names).values())
    who = statistics_members(
        collection,
        exclude=exclude,
        right=right,
        include_doubtful=include_doubtful,
        include_incomplete=include_doubtful,
    )
    is_superimposed = space == "procrustes"
    is_chosen = is_superimposed or bool(exclude) or right is not None
    if is_superimposed and who.too_few(1):
        raise InputError(f"space: {who.too_few(1)}")
    folder = Path(to)
    omitted = {"excluded"} if right is None else {"excluded", LESS_SURE, "alone"}
    absent = {name for name, reason in who.left_out if reason in omitted}
    written = [at for at, name in enumerate(collection.names) if name not in absent]
    if right is not None and not written:
        raise InputError(f"right: {collection.select(right=right)}")
    try:
        with OutputFolder.open(
            folder, writer=f"export {format}", inputs=collection.inputs
        ) as output:
            request = ExportRequest(
                system=system,
                collection=collection.some(np.array(written, dtype=np.int64))
                if absent
                else collection,
                output=output,
                who=who,
                space=space,
                semilandmarks=() if is_superimposed else semilandmarks,
            )
            if is_superimposed:
                request = request.counted
            staged = FORMATS[format](request)
            if is_chosen:
                of_files = [one for one in who.left_out if one[0] in absent]
                listed = who if is_superimposed else replace(who, left_out=tuple(of_files))
                staged = (*staged, output.stage_table(listed.table, LEFT_OUT_FILE))
            of_format = _format_notes(collection, format, space)
            if right is not None:
                of_format.append(collection.select(right=right).note)
            said = _chosen_notes(collection, who) if is_chosen else collection.notes
            notes = "".join(f"{note_text(note)}\n" for note in (*of_format, *said))
            output.stage_text(notes, _notes_file(format))
            decided = {
                "result": result_place(collection, folder),
                "space": space,
                "exclude": exclude,
                "right": right,
                "include_doubtful": include_doubtful,
            }
            write_tool_record(output, f"export {format}", decided)
            output.publish()
            return tuple(output.published(path) for path in staged)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({system_reason(error)})") from error


def usual_space(format: str, otherwise: Space = "aligned") -> Space:
    """Return the coordinates of a format where none are asked for: of the files' sizes for statistics and scans."""
    return "unscaled" if format in (*STATISTICS, *SCANS) else otherwise


def notes_of_export(folder: Path, format: str) -> list[str]:
    """Return what a reader must know of an export in a folder, the notes of the alignment included."""
    return read_text(folder / _notes_file(format)).splitlines()


def _notes_file(format: str) -> str:
    return f"notes-{format}.txt"


def _format_notes(collection: Collection, format: str, space: Space) -> list[Note]:
    """Return what coordinates and transforms of a format are."""
    is_placed = format in (*STATISTICS, "slicer-json")
    notes = [coordinates_note(collection, space)] if is_placed else []
    return notes + ([_DIRECTIONS[format]] if format in _DIRECTIONS else [])


def _chosen_notes(collection: Collection, who: Members) -> list[Note]:
    """Return who counts, how the others differ, and what else is said of a result."""
    _, differences = compare_members(collection, who, collection.labels)
    return [*who.notes, *differences, *who.not_said_by(collection.notes)]
