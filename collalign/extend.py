"""Adds shapes to a finished collection without moving those that are in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from collalign.align import align_listing
from collalign.engine.progress import progress_display
from collalign.engine.run_options import RunOptions
from collalign.engine.session import ProgressFactory, Session
from collalign.options import AlignOptions
from collalign.output.collection import Collection
from collalign.output.loading import load
from collalign.output.moved_files import is_there
from collalign.products.pair import FormerPairs
from data_tools.arrays import read_only
from data_tools.checks import as_options
from data_tools.errors import InputError
from data_tools.io.files import readable_name
from data_tools.io.listing import FolderListing, hash_shape
from data_tools.io.objects import ShapesLike, list_shapes
from data_tools.io.source import Origin, Source
from data_tools.threads import one_blas_thread


@one_blas_thread()
def add_to_collection(
    result: Collection | str | Path,
    shapes: ShapesLike,
    *,
    run: RunOptions | Mapping[str, Any] | None = None,
    recursive: bool = False,
    parts: bool = False,
    include: Sequence[str] = (),
    columns: str = "",
    kinds: Mapping[str, str] | Literal["", "folder"] = "",
    progress: ProgressFactory | bool = True,
) -> Collection:
    """Align more shapes to an existing result, with the options of that result.

    Whether shapes may be reflected stays as it was decided for the result. A specimen of the other side that comes to
    a collection without mirror images is therefore not reflected; a note says that it looks like one.

    Parameters
    ----------
    result : Collection or path
        A result, or the folder that :meth:`Collection.save` wrote.
    shapes : str, Path, iterable or mapping
        The new shapes, as :func:`collalign.align_collection` takes them. Files whose content the collection has
        already are skipped, whatever they are called: an inbox can be added again and again. A shape whose name is
        taken is called by its folder as well (``new/desk_00``). Files of the result that were moved or renamed are
        recognised by their content, even where another file has the old name.
    run : RunOptions or mapping, optional
        With the store of the first run, no old pair is matched again.
    recursive, parts, include, progress
        As in :func:`collalign.align_collection`.
    columns : str, optional
        As in :class:`CleaningOptions`, where the result was made without.
    kinds
        Of the new shapes by their names in ``shapes``, as in :func:`collalign.align_collection`. Old shapes stay of
        their kind.

    Returns
    -------
    Collection
        The old shapes first, with exactly their old transforms and confidences, then the new ones. What the first run
        left out is still named; ``run.known`` lists the files that were skipped. Without a new file this is the
        result as it was loaded, and there is nothing to save.

    Raises
    ------
    InputError
        If the folder holds no result, an old file has vanished or changed, a shape from memory has a name that is
        taken, or the result was made with other ``columns``.

    Examples
    --------
    >>> more = collalign.add_to_collection("aligned", "more")
    >>> more.names
    ('A', 'B', 'C', 'D')
    >>> bool((more.transforms[:3] == collalign.load("aligned").transforms).all())
    True
    """
    former = load(result)
    if not all(former.files):
        former.source_files()  # which says what came from memory, before any folder is looked at
    listed = list_shapes(shapes, recursive=recursive, parts=parts, include=include)
    former = _with_moved(former, listed)
    files = former.source_files()
    options = _with_columns(former.options, columns)
    new, known = _without_known(listed, former.names, files)
    if not new.files:
        return replace(former, run=replace(former.run, known=known))
    listed_as = former.names + new.names
    new = replace(new, names=_free_names(new, former.names))
    listing = FolderListing(
        files=files + new.files, names=former.names + new.names, skipped=new.skipped
    )
    edges = np.array(
        [sorted((pair.target, pair.source)) for pair in former.pairs], dtype=np.int64
    ).reshape(-1, 2)
    with Session.open(
        options, as_options("run", run, RunOptions), progress_display(progress)
    ) as session:
        aligned = align_listing(
            session,
            listing,
            kept=dict(zip(former.names, former.transforms, strict=True)),
            former=FormerPairs(
                num_shapes=len(files), edges=edges, group=former.group, kinds=former.kinds
            ),
            incomplete=[former.names[one.shape] for one in former.incomplete],
            kinds=kinds,
            listed_as=listed_as,
        )
    stated = dict(zip(former.names, former.confidence.tolist(), strict=True))
    confidence = [
        stated.get(name, own)
        for name, own in zip(aligned.names, aligned.confidence.tolist(), strict=True)
    ]
    again = {file.name for file in new.files}
    left_out = tuple(one for one in former.excluded if one.file not in again)
    return replace(
        aligned,
        confidence=read_only(np.array(confidence)),
        by_hand=former.by_hand,
        excluded=(*left_out, *aligned.excluded),
        run=replace(aligned.run, known=known),
    )


def _with_moved(former: Collection, listed: FolderListing) -> Collection:
    """Return a result whose files that are not where they were lie among those listed, by their content.

    Raises
    ------
    InputError
        If another content is where a file was, and its own is nowhere.
    """
    lost = [
        at
        for at, (file, digest) in enumerate(zip(former.files, former.digests, strict=True))
        if file and not (is_there(file) and _digest(Path(file)) == digest)
    ]
    if not lost:
        return former
    found = {_digest(file): str(file) for file in listed.files if isinstance(file, Path)}
    files = [*former.files]
    for at in lost:
        files[at] = found.get(former.digests[at], files[at])
        if files[at] == former.files[at] and is_there(files[at]):
            raise InputError(
                f"{files[at]}: has changed since it was aligned as {former.names[at]}, so it is another shape. Put "
                "the old file back, add the folder that holds it now, or align all shapes again"
            )
    return replace(former, files=tuple(files))


def _free_names(new: FolderListing, taken: Sequence[str]) -> tuple[str, ...]:
    """Return the names of new shapes, with as many of their folders as tell them from those that are taken.

    Raises
    ------
    InputError
        If a shape from memory has a name that is taken, or no folder tells two files apart.
    """
    used, names = {*taken, *new.names}, list[str]()
    for name, file in zip(new.names, new.files, strict=True):
        free = name
        if name in taken:
            above = [] if isinstance(file, Source) else [*file.absolute().parents]
            for folder in above[name.count("/") :]:
                free = f"{readable_name(folder)}/{free}"
                if free not in used:
                    break
            if free in used:
                raise InputError(
                    f"the collection has a shape called {name!r} already; rename the new one"
                )
        used.add(free)
        names.append(free)
    return tuple(names)


def _with_columns(options: AlignOptions, columns: str) -> AlignOptions:
    """Return the options of a result with the columns of the tables that come to it."""
    known = options.cleaning.columns
    if not columns or columns == known:
        return options
    if known:
        raise InputError(
            f"columns: the result was made with {known!r}, and its tables are read again. Give new tables the same "
            "columns, or headings"
        )
    return replace(options, cleaning=replace(options.cleaning, columns=columns))


def _without_known(
    new: FolderListing, names: Sequence[str], files: Sequence[Path]
) -> tuple[FolderListing, tuple[str, ...]]:
    """Return the files that the collection does not have, and words for those that it has, by content and format."""
    sizes = {_size(file) for file in new.files}
    shape_of = {
        (_digest(file), file.suffix.lower()): name
        for name, file in zip(names, files, strict=True)
        if _size(file) in sizes
    }
    kept, known = list[int](), list[str]()
    for at, file in enumerate(new.files):
        name = shape_of.get((_digest(file), file.suffix.lower())) if shape_of else None
        if name is None:
            kept.append(at)
        else:
            shown = file.name if isinstance(file, Source) else readable_name(file)
            known.append(f"{shown} (as {name})")
    return replace(new.some(kept), skipped=new.skipped), tuple(known)


def _size(file: Origin) -> int | None:
    """Return the size of a file, which tells most contents apart unread; None of a specimen of parts."""
    if isinstance(file, Source):
        return len(file.content)
    return file.stat().st_size if file.is_file() else None


def _digest(file: Origin) -> str | None:
    """Return the digest of a file's content; None where it cannot be read, which the run says then."""
    try:
        return hash_shape(file)
    except InputError:
        return None
