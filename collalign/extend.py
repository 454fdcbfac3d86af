"""Adds shapes to a finished collection without moving those that are in it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from collalign.align import align_listing
from collalign.collection import AlignedCollection
from collalign.engine.options import RunOptions
from collalign.engine.session import ProgressFactory, Session
from collalign.options import options_from_record
from collalign.output.evidence.file import load_view
from collalign.output.write import ALIGNMENT_FILE
from collalign.products.pair import FormerPairs
from collalign.products.shapes import Excluded
from data_tools.errors import InputError
from data_tools.io.shapes import FolderListing, read_folder
from data_tools.threads import one_blas_thread


@one_blas_thread()
def add_to_collection(
    result: str | Path,
    folder: str | Path,
    *,
    run: RunOptions | None = None,
    progress: ProgressFactory | None = None,
) -> AlignedCollection:
    """Align the shapes of a folder to an existing result, with the options of that result.

    Whether shapes may be mirrored stays as it was decided for the result. A specimen of the other side that comes to
    a collection without mirror images is therefore not mirrored; a note says that it looks like one.

    Parameters
    ----------
    result : str or Path
        Folder that :meth:`AlignedCollection.save` wrote.
    folder : str or Path
        The new shapes; their names must be new as well.
    run : RunOptions, optional
        With the store of the first run, no old pair is matched again.
    progress : callable, optional

    Returns
    -------
    AlignedCollection
        The old shapes first, with exactly their old transforms, then the new ones. What the first run left out is
        still named.

    Raises
    ------
    InputError
        If the folder holds no result, an old file has vanished or a name is taken.
    """
    view = load_view(result)
    record = Path(result) / ALIGNMENT_FILE
    try:
        content = json.loads(record.read_text("utf-8"))
        options = options_from_record(content["options"])
        group = options.group if options.group != "auto" else str(content["decided"]["group"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{record}: not the summary of an alignment ({error})") from None
    files = tuple(Path(file) for file in view.files)
    for file in files:
        if not file.is_file():
            raise InputError(f"{file}: a shape of the collection is not there any more; put it back to add to it")
    new = read_folder(folder)
    taken = sorted(set(view.names) & set(new.names))
    if taken:
        raise InputError(f"{folder}: the collection has a shape called {taken[0]!r} already; rename the new file")
    listing = FolderListing(files=files + new.files, names=view.names + new.names, skipped=new.skipped)
    edges = np.array([sorted((pair.target, pair.source)) for pair in view.pairs], dtype=np.int64).reshape(-1, 2)
    with Session.open(options, run or RunOptions(), progress) as session:
        aligned = align_listing(
            session,
            listing,
            fixed=dict(zip(view.names, view.rotations, strict=True)),
            placed=dict(zip(view.names, view.transforms, strict=True)),
            former=FormerPairs(num_shapes=len(files), edges=edges, group=group),
        )
    again = {file.name for file in new.files}
    left_out = tuple(Excluded(file=file, reason=reason) for file, reason in view.excluded if file not in again)
    return replace(aligned, excluded=(*left_out, *aligned.excluded))
