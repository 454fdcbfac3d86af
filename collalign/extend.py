"""Adds shapes to a finished collection without moving those that are in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from collalign.align import align_listing
from collalign.engine.run_options import RunOptions
from collalign.engine.session import ProgressFactory, Session, progress_display
from collalign.output.collection import Collection
from collalign.output.evidence.loading import load
from collalign.products.pair import FormerPairs
from data_tools.arrays import read_only
from data_tools.checks import as_options
from data_tools.errors import InputError
from data_tools.io.listing import FolderListing
from data_tools.io.objects import ShapesLike, list_shapes
from data_tools.threads import one_blas_thread


@one_blas_thread()
def add_to_collection(
    result: str | Path,
    shapes: ShapesLike,
    *,
    run: RunOptions | Mapping[str, Any] | None = None,
    recursive: bool = False,
    parts: bool = False,
    progress: ProgressFactory | bool = True,
) -> Collection:
    """Align more shapes to an existing result, with the options of that result.

    Whether shapes may be mirrored stays as it was decided for the result. A specimen of the other side that comes to
    a collection without mirror images is therefore not mirrored; a note says that it looks like one.

    Parameters
    ----------
    result : str or Path
        Folder that :meth:`Collection.save` wrote.
    shapes : str, Path, iterable or mapping
        The new shapes, as :func:`collalign.align_collection` takes them; their names must be new as well.
    run : RunOptions or mapping, optional
        With the store of the first run, no old pair is matched again.
    recursive, parts, progress
        As in :func:`collalign.align_collection`.

    Returns
    -------
    Collection
        The old shapes first, with exactly their old transforms and confidences, then the new ones. What the first run
        left out is still named.

    Raises
    ------
    InputError
        If the folder holds no result, an old file has vanished or a name is taken.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> points = np.random.default_rng(0).random((40, 3))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     a, b, c = (pathlib.Path(folder, "shapes", name) for name in ("a.xyz", "b.xyz", "c.xyz"))
    ...     a.parent.mkdir()
    ...     for file in (a, b, c):
    ...         np.savetxt(file, points)
    ...     files = collalign.align_collection([a, b], progress=False).save(folder + "/result")
    ...     collalign.add_to_collection(folder + "/result", [c], progress=False).names
    ('a', 'b', 'c')
    """
    former = load(result)
    files = former.source_files()
    new = list_shapes(shapes, recursive=recursive, parts=parts)
    taken = sorted(set(former.names) & set(new.names))
    if taken:
        raise InputError(f"the collection has a shape called {taken[0]!r} already; rename the new one")
    listing = FolderListing(files=files + new.files, names=former.names + new.names, skipped=new.skipped)
    edges = np.array([sorted((pair.target, pair.source)) for pair in former.pairs], dtype=np.int64).reshape(-1, 2)
    with Session.open(former.options, as_options("run", run, RunOptions), progress_display(progress)) as session:
        aligned = align_listing(
            session,
            listing,
            fixed=dict(zip(former.names, former.transforms, strict=True)),
            former=FormerPairs(num_shapes=len(files), edges=edges, group=former.group),
            incomplete=[former.names[one.shape] for one in former.incomplete],
        )
    known = dict(zip(former.names, former.confidence.tolist(), strict=True))  # being fixed makes no old pose surer
    confidence = [known.get(name, own) for name, own in zip(aligned.names, aligned.confidence.tolist(), strict=True)]
    again = {file.name for file in new.files}
    left_out = tuple(one for one in former.excluded if one.file not in again)
    return replace(aligned, confidence=read_only(np.array(confidence)), excluded=(*left_out, *aligned.excluded))
