"""Landmarks of a few specimens carried to all others of an aligned collection, with calibrated error radii."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

from collalign.engine.progress import progress_display
from collalign.engine.run_options import RunOptions
from collalign.engine.session import ProgressFactory
from collalign.output.collection import Collection
from collalign.output.loading import load
from collalign.template_landmarks.on_surface import place_templates
from collalign.template_landmarks.sides import side_notes
from collalign.template_landmarks.table import landmark_table
from collalign.template_landmarks.templates import (
    SemilandmarkKeywords,
    SemilandmarkRequest,
    read_templates,
    with_semilandmarks,
)
from collalign.tools.correspond import dense_correspondence
from collalign.tools.transfer.carrier import LandmarkCarrier
from collalign.tools.transfer.result import TransferredLandmarks
from collalign.tools.transfer.slid import with_slid
from data_tools.checks import as_options
from data_tools.landmark_files import Landmarks
from data_tools.names import by_known_names
from data_tools.notes import Note
from data_tools.threads import one_blas_thread


@one_blas_thread()
def transfer_landmarks(
    result: Collection | str | Path,
    landmarks: Mapping[str, Landmarks] | Sequence[str | Path],
    *,
    semilandmarks: SemilandmarkRequest | Mapping[str, Any] | None = None,
    sources: str | Path | None = None,
    run: RunOptions | Mapping[str, Any] | None = None,
    progress: ProgressFactory | bool = True,
    **keywords: Unpack[SemilandmarkKeywords],
) -> TransferredLandmarks:
    """Carry landmarks from the specimens that have them to all others.

    Parameters
    ----------
    result : Collection or path
        A result, or the folder that ``collalign align`` wrote.
    landmarks : mapping of name to Landmarks, or sequence of path
        In file coordinates, or in LPS or RAS where that is declared. A file ``A.mrk.json``, ``A.fcsv``, ``A.csv``
        or ``A.pts`` belongs to the shape called A, or to B as ``"B=A.csv"``; TPS, NTS and morphologika name their
        specimens.
        Markups of the type Curve and ClosedCurve are curves of semilandmarks.
    semilandmarks : SemilandmarkRequest or mapping, optional
    sources : path, optional
        Folder that holds the original files now, where they have moved.
    run : RunOptions, optional
    progress : bool or callable
        As in :func:`collalign.align_collection`.
    **keywords
        Fields of ``semilandmarks`` by themselves, which win: ``curves=["RIM/A.fcsv"]``, ``surface_points=500``.

    Raises
    ------
    InputError
        If a file belongs to no shape, its landmarks do not lie on that, or two templates have no landmark in common.
    CollectionError
        If the shapes cannot be registered.

    Notes
    -----
    Shapes of confidence below the result's threshold get no landmarks, incomplete ones none where they have nothing.
    From three templates on, one that contradicts the others at a landmark does not count there.

    Examples
    --------
    >>> found = collalign.landmarks.transfer_landmarks("aligned", ["A.fcsv"])
    >>> found.labels, found.status[1]
    (('top', 'foot'), ('carried over', 'carried over'))
    """
    collection = load(result, sources=sources)
    wanted = as_options("semilandmarks", semilandmarks, SemilandmarkRequest, keywords)
    given = (
        dict(landmarks)
        if isinstance(landmarks, Mapping)
        else read_templates(landmarks, collection.names)
    )
    given = by_known_names(
        "landmarks", with_semilandmarks(given, wanted, collection.names), collection.names
    )
    rows = {name: collection.index(name) for name in given}
    meshes = tuple(
        (name, *mesh) for name, mesh in zip(collection.names, collection.surfaces, strict=True)
    )
    transforms = {name: collection.transforms[at] for name, at in rows.items()}
    placed, notes, system = place_templates(
        given,
        {name: collection.file(at) for name, at in rows.items()},
        meshes,
        collection.options.cleaning,
        transforms=transforms,
    )
    table = landmark_table(placed, transforms, curve_points=wanted.curve_points)
    dense = dense_correspondence(collection, run=run, progress=progress)
    carrier = LandmarkCarrier(collection, dense, table)
    if renamed := carrier.same_places():
        carrier = LandmarkCarrier(collection, dense, table.renamed(renamed))
        notes += tuple(
            Note(
                "landmarks-renumbered",
                (name,),
                {"labels": (*pairs,), "taken_as": (*pairs.values(),)},
            )
            for name, pairs in renamed.items()
        )
    found = carrier.run(wanted.surface_points, progress_display(progress))
    if wanted.slide is not None:
        found = with_slid(found, collection, wanted.slide)
    for name, points in table.points.items():
        notes += tuple(side_notes(name, table.labels, points))
    return replace(found, notes=(*notes, *table.notes, *found.notes), system=system)
