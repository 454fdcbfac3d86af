"""``collalign align``, ``collalign add`` and ``collalign demo``."""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Parameter

import collalign
from collalign.analysis.label_table import Labels, read_labels
from collalign.cli.check import check_shapes
from collalign.cli.own_file import read_marks, read_own
from collalign.console.help import Excluded, Flag, Included
from collalign.console.interruption import INCOMPLETE, resumable
from collalign.console.messages import add_to_summary, elapsed_s, say, say_files, warn
from collalign.console.running import Run
from collalign.engine.local_pool import lasting_workers
from collalign.engine.progress import ProgressBar, progress_display
from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from collalign.engine.store import Store
from collalign.engine.store_file import FINISHED, STAGE
from collalign.options import AlignOptions
from collalign.output.collection import Collection
from collalign.output.corrections import fixed_by, read_corrections
from collalign.output.label_notes import with_label_notes
from collalign.output.loading import load
from collalign.output.moved_files import is_there
from collalign.output.write import (
    ALIGNMENT_FILE,
    REPORT_FILE,
    WRITER,
    output_names,
    save_collection,
)
from collalign.products.own import Own
from collalign.products.run_record import REST
from collalign.wording import note_records, note_text
from data_tools.arrays import FloatArray
from data_tools.datasets.synthetic import PlantedCollection, demo_collection, write_collection
from data_tools.errors import InputError, OptionsError
from data_tools.io.files import natural_key
from data_tools.io.listing import FolderListing, hash_shape, read_folder
from data_tools.io.objects import list_shapes
from data_tools.io.output_folder import OutputFolder, refuse_overlap
from data_tools.io.source import inputs_of, location
from data_tools.notes import Note, listed, percent
from data_tools.poses import scales_of
from data_tools.rotations import rotation_angle_deg

#: What is done to nearly every file and loses nothing of its surface; said of each in ``alignment.json`` alone.
_USUAL = {
    *(
        "made-of-parts",
        "duplicates-merged",
        "not-kept",
        "coarse-steps",
        "subsampled",
        "decimated",
        "edge-geodesics",
    ),
    *("tufted-laplacian", "degenerate-dropped", "unreferenced-dropped"),
}


@dataclass(frozen=True, kw_only=True)
class Given:
    """How shapes are read, and what is known of them, in addition to the options of an alignment.

    Parameters
    ----------
    recursive : bool
        Take the folders in a folder too; their shapes are called folder/name.
    parts : bool
        The files of a folder in a folder, and A.part.ply, are parts of one specimen that move as one.
    corrections : list of Path, optional
        Decisions downloaded from the report: poses that are kept, with no pair matched again. Once for each file.
    labels : Path, optional
        CSV file with one row per shape (name, then columns such as taxon), for the report.
    marks : Path, optional
        Landmark file of one shape, called like it or given as SHAPE=FILE, for --up, --front and --origin.
    kinds_by : str
        What says which shapes are of one kind, where you know it: folder, or a column of --labels.
    own : Path, optional
        JSON file with candidate poses and weights of pairs, samples and descriptors of your own.
    order : str
        Scans in the order in which they were taken, for --incomplete all: their names with commas between them, or
        "names" if it is that of their names, with numbers as numbers.
    """

    recursive: Flag = False
    parts: Flag = False
    corrections: Annotated[list[Path] | None, Parameter(negative=())] = None
    exclude: Excluded = ()
    include: Included = ()

    labels: Path | None = None
    marks: Path | None = None
    kinds_by: str = ""
    own: Path | None = None
    order: str = ""


def align(
    folder: Annotated[list[Path], Parameter(negative=())],
    *,
    out: Path | None = None,
    check: Flag = False,
    report: bool = True,
    drop: Flag = False,
    given: Annotated[Given, Parameter(name="*")] = Given(),
    options: Annotated[AlignOptions, Parameter(name="*")] = AlignOptions(),  # noqa: B008
    run: Run = RunOptions(),  # noqa: B008
) -> int:
    """Align all shapes of a folder, or of several.

    Parameters
    ----------
    folder
        Folders of meshes and point clouds in any poses; or files, patterns ('left/A*.stl'), @FILE with one of
        these a line.
    out
        Folder for the results; an interrupted run goes on from the store in it.
        Needed but with --check.
    check
        Only read every file and say what is in it: nothing is aligned or written.
    report
        Write report.html.
    drop
        Leave out shapes of the result in --out that are not named any more, such as those of `collalign add`.
    """
    from collalign.align import align_listing  # what computes, which help does without

    every, inputs = _listed(
        folder if folder[1:] else folder[0],
        recursive=given.recursive,
        parts=given.parts,
        include=given.include,
    )
    listing = every.without(given.exclude)
    own, of_own = (Own(), set[Path]()) if given.own is None else read_own(given.own, listing.names)
    inputs |= of_own
    own = replace(own, order=_order(given.order, listing.names))
    if given.marks is not None:
        own, of_marks = read_marks(own, given.marks, listing, options.cleaning)
        inputs |= of_marks
    if out is not None:
        refuse_overlap(out, inputs)
    decided = [read_corrections(path) for path in given.corrections or ()]
    fixed, kept = fixed_by(decided, listing.names, options.incomplete)
    table = _labels(given.labels, listing.names)
    kinds = _kinds(given.kinds_by, table, listing.names)
    if check:
        return check_shapes(listing, options, run)
    if out is None:
        raise OptionsError("--out: which folder gets the results?")
    folders = OutputFolder.open(out, writer=WRITER, inputs=inputs)
    with resumable(run, out) as run, folders as output, lasting_workers():
        output.refuse_foreign(output_names(listing.names))
        if not drop:
            _refuse_to_drop(out, every)
        with Session.open(options, run, progress_display(True)) as session:
            incomplete = {name for one in decided for name in one.incomplete}
            collection = align_listing(
                session,
                listing,
                fixed=fixed,
                kept=kept,
                incomplete=incomplete,
                own=own,
                kinds=kinds,
            )
        collection = _with_notes_of(collection, table)
        written = _save(collection, output, table, run, report=report)
    return _finish(collection, written)


def _order(asked: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of scans in the order that is asked for, if one is."""
    if asked == "names":
        return tuple(sorted(names, key=natural_key))
    return tuple(name.strip() for name in asked.split(",")) if asked else ()


def add(
    result: Path,
    folder: Annotated[list[Path], Parameter(negative=())],
    *,
    recursive: Flag = False,
    parts: Flag = False,
    include: Included = (),
    columns: str = "",
    labels: Path | None = None,
    kinds_by: str = "",
    report: bool = True,
    run: Run = RunOptions(),  # noqa: B008
) -> int:
    """Align new shapes to a finished result without moving the old ones.

    Parameters
    ----------
    result
        Folder that ``collalign align`` wrote; it is brought up to date.
    folder
        The new shapes, as in ``collalign align``. Files that the result has already are skipped, by content.
    recursive, parts, include
        As in ``collalign align``.
    columns
        Names of the columns of new text tables, as in ``collalign align``, where the result was made without.
    labels
        CSV file with one row per shape, old and new, for the report.
    kinds_by
        What says of which kind the new shapes are: folder, or a column of --labels.
    report
        Write report.html.
    """
    listing, inputs = _listed(folder, recursive=recursive, parts=parts, include=include)
    folders = OutputFolder.open(result, writer=WRITER, inputs=inputs)
    with resumable(run, result) as run, folders as output, lasting_workers():
        former = load(result)
        table = _labels(labels, (*former.names, *listing.names))
        collection = collalign.add_to_collection(
            former,
            listing,
            columns=columns,
            kinds=_kinds(kinds_by, table, listing.names),
            run=run,
        )
        _say_known(collection)
        if collection.fresh is None:
            say("There is nothing new to add; the result stays as it is.")
            return 0
        collection = _with_notes_of(collection, table)
        written = _save(collection, output, table, run, report=report)
    return _finish(collection, written)


def demo(
    *,
    out: Path = Path("collalign-demo"),
    num_shapes: int = 10,
    options: Annotated[AlignOptions, Parameter(name="*")] = AlignOptions(),  # noqa: B008
    run: Run = RunOptions(),  # noqa: B008
) -> int:
    """Generate a small collection in random poses, align it, and compare with the truth.

    Parameters
    ----------
    out
        Folder for the generated shapes and the results.
    num_shapes
        How many shapes to generate.
    """
    start_s = time.perf_counter()
    if num_shapes < 2:
        raise OptionsError(f"--num-shapes: expected at least 2, got {num_shapes}")
    say(
        f"This generates {num_shapes} chairs in random poses, aligns them consistently and compares with the truth."
    )
    planted = demo_collection(seed=options.seed, num=num_shapes)
    with OutputFolder.open(out / "shapes", writer="demo") as output:
        write_collection(output.staging, planted)
        files = output.publish(complete=True)
    if not {path.absolute() for path in read_folder(out / "shapes").files} <= {
        path.absolute() for path in files
    }:
        raise InputError(
            f"{out / 'shapes'}: holds other shapes as well, from an earlier call; choose another --out"
        )
    if not options.reference and options.gauge == "reference":
        # The shape that stands most upright in pictures: their up is y, a chair's is z.
        options = replace(
            options, reference=planted.shapes[int(np.argmax(planted.rotations[:, 2, 1]))].name
        )
    code = align([out / "shapes"], out=out / "aligned", options=options, run=run)
    if code in (0, INCOMPLETE):
        errors = _errors_deg(out / "aligned" / ALIGNMENT_FILE, planted)
        median, worst = float(np.median(errors)), float(errors.max())
        add_to_summary(median_error_deg=median, worst_error_deg=worst)
        say(
            f"Rotation error against the truth, over all pairs: median {median:.2f} deg, worst {worst:.2f} deg"
        )
    say(
        f"Took {time.perf_counter() - start_s:.0f} s. The shapes, the result, and the page to open in a browser:"
    )
    for path in (out / "shapes", out / "aligned", out / "aligned" / REPORT_FILE):
        say(str(path))
    return code


def _listed(
    given: Path | list[Path], *, recursive: bool, parts: bool, include: Sequence[str] = ()
) -> tuple[FolderListing, set[Path]]:
    """Return the shapes that places hold, and all that results must lie apart from."""
    listing = list_shapes(given, recursive=recursive, parts=parts, include=include)
    places = given if isinstance(given, list) else [given]
    return listing, {
        *(Path(str(place).removeprefix("@")) for place in places),
        *inputs_of(listing.files),
    }


def _refuse_to_drop(out: Path, listing: FolderListing) -> None:
    """Refuse to replace a result of more shapes by one without them, where their files are still there.

    Raises
    ------
    InputError
        Naming them.
    """
    if not (out / ALIGNMENT_FILE).is_file():
        return
    try:
        former = load(out)
    except InputError:  # the run makes it anew
        return
    files = {location(file.absolute()) for file in listing.files}
    dropped = {
        name: digest
        for name, file, digest in zip(former.names, former.files, former.digests, strict=True)
        if name not in listing.names and file not in files and is_there(file)
    }
    if dropped:
        contents = set[str]()
        for file in listing.files:
            with suppress(InputError):  # the run says why a file cannot be read
                contents.add(hash_shape(file))
        dropped = {name: digest for name, digest in dropped.items() if digest not in contents}
    if dropped:
        shown = ", ".join([*dropped][:10]) + (", ..." if len(dropped) > 10 else "")
        raise InputError(
            f"{out}: the result there has {len(dropped)} more shapes, which would be lost: {shown}. Name their files "
            "too, or another --out; with --drop they are left out"
        )


def _say_known(collection: Collection) -> None:
    """Say which files were not added because the collection has them."""
    known = collection.run.known
    if known:
        shown = ", ".join(known[:10]) + (", ..." if known[10:] else "")
        say(f"Skipped {len(known)} files that the collection has already: {shown}")
    add_to_summary(known=known)


def _labels(path: Path | None, names: Sequence[str]) -> Labels | None:
    """Read a table of labels, and warn of names that do not fit before hours go by."""
    if path is None:
        return None
    table = read_labels(path)
    table.check_fit(names)
    for note in table.mismatches(names):
        warn(note_text(note))
    return table


def _kinds(
    kinds_by: str, table: Labels | None, names: Sequence[str]
) -> dict[str, str] | Literal["", "folder"]:
    """Return the kind of each shape that has a label, or that the folders say it."""
    if kinds_by == "folder":
        return "folder"
    if not kinds_by:
        return ""
    if table is None:
        raise OptionsError(
            f"--kinds-by: expected 'folder' or a column of --labels, got {kinds_by!r} without --labels"
        )
    columns = table.columns_for(names)
    if kinds_by not in columns:
        raise InputError(
            f"--kinds-by: the labels have no column {kinds_by!r}; there are {listed([*columns])}"
        )
    return {name: kind for name, kind in zip(names, columns[kinds_by], strict=True) if kind}


def _with_notes_of(collection: Collection, table: Labels | None) -> Collection:
    """Return the collection whose notes say what labels contradict of it."""
    columns = {} if table is None else table.columns_for(collection.names)
    return with_label_notes(collection, columns)


def _save(
    collection: Collection,
    output: OutputFolder,
    table: Labels | None,
    run: RunOptions,
    *,
    report: bool,
) -> tuple[Path, ...]:
    """Write the outputs, with a progress bar where somebody watches a terminal; the store says so meanwhile."""
    _set_stage(run, "outputs")
    times_s = (
        collection.run.times_s
    )  # with the start of the program and the list of files, all of the command so far
    rest_s = times_s.get(REST, 0.0) + max(0.0, elapsed_s() - sum(times_s.values()))
    collection = replace(collection, run=replace(collection.run, times_s=times_s | {REST: rest_s}))
    columns = table.columns_for(collection.names) if table is not None else None
    if table is not None:
        collection = replace(
            collection, notes=(*collection.notes, *table.mismatches(collection.names))
        )
    with ProgressBar("outputs", len(collection.names)) as bar:
        written = save_collection(
            collection,
            output,
            report=report,
            labels=columns,
            advance=bar.advance,
            num_jobs=run.num_workers,
        )
    _set_stage(run, FINISHED)
    return written


def _set_stage(run: RunOptions, stage: str) -> None:
    """Note in the store how far the run is."""
    assert run.store is not None
    with Store.open(run.store) as opened:
        opened.set_note(STAGE, stage)


def _errors_deg(alignment: Path, planted: PlantedCollection) -> FloatArray:
    """Return the angle between found and true relative rotation of every pair."""
    shapes = json.loads(alignment.read_text())["shapes"]
    linear = {shape["name"]: np.array(shape["transform"])[:3, :3] for shape in shapes}
    frames = {
        i: linear[shape.name] / scales_of(linear[shape.name])
        for i, shape in enumerate(planted.shapes)
        if shape.name in linear
    }
    return np.array(
        [
            rotation_angle_deg(frames[i].T @ frames[j], planted.relative_rotation(i, j))
            for i, j in itertools.combinations(frames, 2)
        ]
    )


def _doubtful(collection: Collection) -> dict[str, float]:
    """Return the confidence of the doubtful shapes, the most doubtful first; of none if nothing was estimated."""
    stated = dict(
        zip(collection.names, np.nan_to_num(collection.confidence, nan=-1.0).tolist(), strict=True)
    )
    if max(stated.values()) < 0:
        return {}
    doubted = {collection.names[at] for at in np.flatnonzero(collection.is_doubtful)}
    return {name: stated[name] for name in sorted(doubted, key=lambda name: (stated[name], name))}


def _finish(collection: Collection, written: Sequence[Path]) -> int:
    """Say what came out, whom to doubt, what was left out, and where everything is; return the exit code."""
    seconds, doubtful = elapsed_s(), _doubtful(collection)
    reused = f" ({collection.run.num_reused} results reused)" if collection.run.num_reused else ""
    say(
        f"Aligned {len(collection.names)} shapes by {len(collection.pairs)} pairs in {seconds:.1f} s{reused}."
    )
    if doubtful:
        shown = [
            f"{name} ({percent(value) if value >= 0 else 'unknown'})"
            for name, value in doubtful.items()
        ]
        say(
            f"Doubtful poses, look at them first: {', '.join(shown[:10])}{', ...' if shown[10:] else ''}"
        )
    for note in collection.notes:
        if note.code != "doubtful":  # named in the line before
            say(f"Note: {note_text(note)}")
    lost = [
        f"{name}: {note_text(note)}"
        for name, notes in zip(collection.names, collection.made.shape_notes, strict=True)
        for note in [note for note in notes if note.code not in _USUAL][:1]
    ]
    if lost:
        more = f" and {len(lost) - 1} more" if lost[1:] else ""
        say(
            f"Matched on a repaired copy ({lost[0]}){more}. Your files stay as they are; {ALIGNMENT_FILE} lists all."
        )
    if collection.run.skipped:
        files = collection.run.skipped
        say(note_text(Note("not-shapes", values={"num": len(files), "files": files})))
    for item in collection.excluded:
        warn(f"Left out: {item.file}: {item.reason}")
    add_to_summary(
        shapes=len(collection.names),
        pairs=len(collection.pairs),
        seconds=seconds,
        reused=collection.run.num_reused,
        doubtful=[
            {"name": name, "confidence": value if value >= 0 else None}
            for name, value in doubtful.items()
        ],
        left_out=[{"file": item.file, "reason": item.reason} for item in collection.excluded],
        skipped=collection.run.skipped,
        notes=note_records(collection.notes),
    )
    say_files(written)
    return INCOMPLETE if collection.excluded else 0
