"""``collalign align --check``: every file is read, and nothing else is done."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any

import numpy as np

from collalign.console.interruption import INCOMPLETE
from collalign.console.messages import add_to_summary, say, warn
from collalign.engine.job import Job, Results, Wanted
from collalign.engine.progress import progress_display
from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from collalign.options import AlignOptions
from collalign.stages.shape_stage import (
    common_num_points,
    decided_cleaning,
    excluded_file,
    few_points,
    left_out_of,
    odd_sizes,
    pieces_of_file,
)
from collalign.wording import note_records, note_text
from data_tools.arrays import FloatArray, Holds, read_only
from data_tools.embedding.copies import find_copies, shape_signature
from data_tools.embedding.sampling import check_determines_pose
from data_tools.errors import CollectionError
from data_tools.io.formats.raw_shape import content_not_kept
from data_tools.io.listing import FolderListing, hash_shape
from data_tools.io.shapes import coarse_coordinates, read_shape
from data_tools.io.source import Origin
from data_tools.landmark_tables import notes_beside
from data_tools.notes import Note
from data_tools.options import NUM_QUANTILES, CleaningOptions
from data_tools.surface.cleaning import hold_pieces, piece_signature
from data_tools.surface.shape import Shape, outward_normals


@dataclass(frozen=True, kw_only=True, eq=False)
class FileFacts:
    """What is said of a shape, which need not be kept for it.

    Attributes
    ----------
    name : str
    points, triangles : int
    size : ndarray, shape (3,)
        Sides of its box.
    notes : tuple of Note
    digest : str
        Of the file's content.
    signature : ndarray, shape (18,)
        See :func:`data_tools.embedding.copies.shape_signature`.
    is_sided : bool
        Whether its triangles agree on a side.
    pieces : ndarray, shape (p, 16)
        See :func:`data_tools.surface.cleaning.piece_signatures`.
    """

    name: str
    points: int
    triangles: int
    size: Annotated[FloatArray, Holds(shape="3")]
    notes: tuple[Note, ...]
    digest: str
    signature: Annotated[FloatArray, Holds(shape="18")]
    is_sided: bool
    pieces: Annotated[FloatArray, Holds(shape="p 16")]

    def record(self) -> dict[str, Any]:
        """Return the facts in JSON types, without what only finds copies."""
        hidden = ("digest", "signature", "is_sided", "pieces")
        shown = {field: value for field, value in asdict(self).items() if field not in hidden}
        return shown | {"notes": note_records(self.notes)}


def look_at_file(file: Origin, cleaning: CleaningOptions, *, name: str) -> FileFacts:
    """Read and clean a file, inside a worker, and return what is said of it."""
    shape = read_shape(file, cleaning, name=name)
    check_determines_pose(shape)
    return FileFacts(
        name=name,
        points=len(shape.vertices),
        triangles=len(shape.faces),
        size=read_only(np.ptp(shape.vertices, axis=0)),
        notes=shape.notes,
        digest=hash_shape(file),
        signature=shape_signature(shape),
        is_sided=len(outward_normals(shape)) > 0,
        pieces=read_only(_looks(file, name, shape, cleaning)),
    )


def _looks(file: Origin, name: str, shape: Shape, cleaning: CleaningOptions) -> FloatArray:
    """Return what the pieces of a shape that may be the object look like, shape (p, 16)."""
    if not shape.is_mesh:
        return np.empty((0, NUM_QUANTILES))
    if hold_pieces(shape.notes):
        return pieces_of_file(file, name, None, cleaning).signatures
    return piece_signature(shape.vertices, shape.faces)[None]


#: Reads a file and keeps nothing of it, within the limits of a run.
_LOOKING = Job(kind="shapes", version="check-2", run=look_at_file, reader=FileFacts)


def check_shapes(listing: FolderListing, options: AlignOptions, run: RunOptions) -> int:
    """Say of each file what is in it or why it would be left out, and which sizes are odd; return the exit code.

    Files are read by workers, within the time and the memory that a run gives a shape.

    Raises
    ------
    CollectionError
        If fewer than two files can be read.
    """
    files = dict(zip(listing.names, listing.files, strict=True))
    with Session.open(options, replace(run, store=None), progress_display(True)) as session:

        def looked_at(cleaning: CleaningOptions) -> Results[str, FileFacts]:
            wanted = {
                name: Wanted(
                    key=_LOOKING.key({"cleaning": cleaning}, name),
                    label=name,
                    arguments={"file": file.absolute(), "cleaning": cleaning, "name": name},
                )
                for name, file in files.items()
            }
            return session.compute(_LOOKING, wanted, time_limit_s=run.shape_time_limit_s)

        found = looked_at(options.cleaning)
        read = [*found.values()]
        decided = decided_cleaning(
            options.cleaning,
            [one.notes for one in read],
            [one.is_sided for one in read],
            lambda: [one.pieces for one in read],
        )
        if decided != options.cleaning:
            found = looked_at(decided)
            read = [*found.values()]
    facts = [one.record() for one in read]
    left_out = [excluded_file(files[name], name, reason) for name, reason in found.failures.items()]
    for one in facts:
        triangles = f", {one['triangles']} triangles" if one["triangles"] else ""
        size = " x ".join(f"{side:.4g}" for side in one["size"])
        merged = "duplicates-merged"  # every STL file repeats its vertices
        texts = [note["text"] for note in one["notes"] if note["code"] != merged]
        say("; ".join([f"{one['name']}: {one['points']} points{triangles}, {size}", *texts]))
    asked = options.sampling.num_points
    counts = {one["name"]: asked if one["triangles"] else one["points"] for one in facts}
    num = common_num_points([*counts.values()], asked)
    notes = [*odd_sizes({one["name"]: float(np.linalg.norm(one["size"])) for one in facts})]
    said = {one.name: one.notes for one in read}
    notes += [*coarse_coordinates(said), *content_not_kept(said), *left_out_of(said)]
    notes += few_points(counts, num, asked)
    signatures = [one.signature for one in read]
    copies = find_copies([*said], [one.digest for one in read], signatures, [*said.values()])
    notes += [*(one.note for one in copies), *notes_beside(listing)]
    skipped = listing.skipped_names
    others = (
        [Note("not-shapes", values={"num": len(skipped), "files": tuple(skipped)})]
        if skipped
        else []
    )
    for note in [*notes, *others]:
        say(f"Note: {note_text(note)}")
    for item in left_out:
        warn(f"Would be left out: {item.file}: {item.reason}")
    missing = [{"file": item.file, "reason": item.reason} for item in left_out]
    add_to_summary(shapes=facts, left_out=missing, skipped=skipped, notes=note_records(notes))
    if len(facts) < 2:
        raise CollectionError(
            f"{len(facts)} readable shapes, at least two are needed to align a collection"
        )
    say(f"{len(facts)} of {len(listing.names)} files can be aligned.")
    return INCOMPLETE if left_out else 0
