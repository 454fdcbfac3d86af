"""The aligned collection: one transform per shape, consistent maps between all of them, and the evidence for both."""

from __future__ import annotations

import base64
import html
import sys
import webbrowser
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from collalign.engine.run_options import RunOptions
from collalign.output.collection_data import CollectionData
from collalign.output.evidence_file import shown_pair
from collalign.output.library_objects import open3d_of, trimesh_of
from collalign.output.members import Selection, select_right
from collalign.output.methods.paragraph import methods_paragraph
from collalign.output.report.page import report_pages, write_report
from collalign.output.views import FEWEST_FACES, contact_sheet, display_mesh, figure_of, tile_of
from collalign.output.write import WRITER, save_collection
from collalign.products.named_frame import NamedFrame
from data_tools.arrays import IntArray
from data_tools.checks import check_choice
from data_tools.errors import CollalignError
from data_tools.io.output_folder import OutputFolder
from data_tools.io.source import inputs_of
from data_tools.io.temporary import TemporaryFolder
from data_tools.notes import percent
from data_tools.surface.shape import Shape

#: Shapes that a notebook shows by itself.
_MOST_IN_NOTEBOOK = 12
#: Where reports of results that are not saved lie while this process lasts: a browser may show them.
_SHOWN: list[TemporaryFolder] = []


@dataclass(frozen=True)
class ReportView:
    """A report, which a notebook shows in a frame."""

    path: Path

    def _repr_html_(self) -> str:
        return _framed(self.path.read_text(encoding="utf-8"))


def open_report(collection: CollectionData) -> ReportView:
    """Return the report of a result, which a terminal opens in the browser; one is written where there is none."""
    path = None if collection.folder is None else collection.folder / "report.html"
    if path is None or not path.is_file():
        _SHOWN.append(TemporaryFolder())
        path = write_report(_part(collection, np.arange(len(collection))), _SHOWN[-1].path)
    if "ipykernel" not in sys.modules:
        webbrowser.open(path.absolute().as_uri())
    return ReportView(path)


def gallery(collection: CollectionData) -> str:
    """Return HTML of the least sure shapes: by name if in doubt, in a frame, and in a picture for where none is."""
    order = np.argsort(np.nan_to_num(collection.confidence), kind="stable")[:_MOST_IN_NOTEBOOK]
    rows = [
        f"<tr><td>{html.escape(one.name)}</td><td>{percent(one.confidence)}</td></tr>"
        for one in (collection[at] for at in order.tolist() if collection.is_doubtful[at])
    ]
    table = (
        f"<table><tr><th>In doubt</th><th>Confidence</th></tr>{''.join(rows)}</table>"
        if rows
        else ""
    )
    summary = f"<p>{html.escape(repr(collection)[1:-1])}</p>{table}"
    try:
        part, title = (
            _part(collection, np.sort(order)),
            f"The {len(order)} least sure of {len(collection)} shapes",
        )
        page = replace(
            next(report_pages(part, Path("report.html"), title=title)), summary="", again=None
        )
        picture = base64.b64encode(
            pictured(collection, np.sort(order).tolist())._repr_png_()
        ).decode()
    except CollalignError:  # a file is not there any more
        return summary
    image = (
        f'<img alt="Before and after" style="max-width:100%" src="data:image/png;base64,{picture}">'
    )
    return (
        f"{summary}{_framed(page.text())}<details><summary>As a picture</summary>{image}</details>"
    )


def pictured(collection: CollectionData, chosen: Iterable[int]) -> Any:
    """Return the figure of matplotlib with some shapes, given by position, before and after alignment."""
    confidence, transforms = collection.confidence, collection.transforms
    tiles = (
        tile_of(collection.shape_at(at), transforms[at], float(confidence[at])) for at in chosen
    )
    return figure_of(contact_sheet(tiles, NamedFrame.of(collection.options)))


def _part(collection: CollectionData, chosen: IntArray) -> CollectionData:
    """Return some shapes of a collection, with meshes to look at."""
    meshes = [
        display_mesh(one.vertices, one.faces, max_faces=FEWEST_FACES)
        for one in map(collection.shape_at, chosen.tolist())
    ]
    vertices, faces = zip(*meshes, strict=True)
    part = replace(collection, vertices=(), faces=(), places=()).some(chosen)
    return replace(
        part, vertices=vertices, faces=faces, pairs=[shown_pair(pair) for pair in part.pairs]
    )


def _framed(page: str) -> str:
    """Return a page, which may come from anybody, in a frame that only runs its scripts and downloads."""
    may = 'sandbox="allow-scripts allow-downloads" allow="clipboard-write"'
    look = 'title="Report" style="width:100%;height:40rem;border:1px solid #8888"'
    return f'<iframe {may} {look} srcdoc="{html.escape(page)}"></iframe>'


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Collection(CollectionData):
    """An aligned collection, just made by :func:`collalign.align_collection` or read by :func:`collalign.load`.

    ``len``, indexing and iteration give the shapes, in natural order of their names; ``pandas.DataFrame`` makes
    tables of their list and of the pairs' list. Arrays are read-only.

    Attributes
    ----------
    names : tuple of str
        N names, unique.
    files : tuple of str
        Where each shape was read from; empty where it came from memory.
    digests : tuple of str
        Of each file's content: a shape keeps it wherever its file moves.
    transforms : ndarray, shape (N, 4, 4)
        Each shape's file coordinates to the common frame, scale and reflection included.
    confidence : ndarray, shape (N,)
        Probability that the pose is the right one of those considered; NaN where it was not estimated.
    samples : ndarray of int, shape (N, k)
        Vertex indices of each shape's samples, as its file counts them; the nearest vertices of objects that are
        assembled of components, whose samples lie anywhere on the surface.
    positions : ndarray, shape (N, k, 3)
        The samples in the common frame.
    maps : ConsistentMaps
    consensus : ndarray, shape (num_labels, 3)
        Mean position of every universe label in the common frame.
    landmarks : ndarray, shape (N, L, 3)
        Points that correspond, in file coordinates, NaN where a shape has none: row b of every shape is its sample of
        label b.
    landmark_names : tuple of str, length L
        ``L1``, ``L2``, ... where nothing is given.
    pairs : Pairs
        In order, and by the names of two shapes. Those of a result that was loaded have the candidates that a person
        would tell apart, without their maps.
    alternatives : tuple of tuple of Alternative
        Other poses of each shape, the likeliest first.
    kinds : tuple of Kind
        Which shapes are of which kind, each posed by itself; empty where all are of one.
    part_numbers : ndarray of int, shape (N,)
        Shapes of different parts are not aligned with each other: their relative poses are unknown or ambiguous.
    excluded : tuple of Excluded
        Files and pairs that were left out.
    notes : tuple of Note
        What a user must know before trusting the whole; :func:`collalign.note_text` puts each into words.
    copies : tuple of Copies
        Shapes that are one and the same surface.
    incomplete : tuple of Incomplete
        The shapes of which parts are missing; what they lack has no labels, and counts in no mean.
    extra : tuple of ExtraMaterial
        Material of single shapes that no other one has, such as a stand. Poses ignore it.
    assembled : tuple of str
        The shapes that were read by all of their components, where the options leave that open.
    limited_by : mapping of str to str
        What limits the confidence of a shape, by its name, as a code: ``no-relative`` (it resembles no other shape),
        ``contradicted`` (points and neighbourhoods would rather have another pose), ``block`` (a block of shapes may
        be rotated as one), ``misfit`` (it fits badly), ``few-shapes``, ``symmetry`` (other poses look alike),
        ``side`` (which side it is of is in doubt), ``partners`` (an incomplete shape is no surer than those that it
        lies on), ``cut-off`` (similar shapes go on beyond its rim, and too few are left to pose it on), ``one-view``
        (it is an image of one side, and images could not be joined as scans),
        ``overlap-alone`` (nothing but overlap joins scans), ``other-reading`` (posed as a whole and as a part of the
        others, it lies in different places). :func:`collalign.reason_text` has the words.
    by_hand : mapping of str to float
        The shapes whose pose a person set, each with the confidence that the evidence alone gives to that pose; NaN
        where there is no evidence. Their ``confidence`` is 1.
    options : AlignOptions
        As asked for.
    own : tuple of str
        What the caller gave in addition to shapes and options: "invariants", "samples", "candidates",
        "correspondences", "pair_weights", "order".
    group : str
        "SO" or "O": whether shapes could be reflected, as asked for or, with ``options.group`` "auto", as decided.
    run : RunRecord
    cycle_errors_deg : ndarray
        Rotation angle left after going around cycles of three pairs.
    labels : mapping of str to tuple of str
        Columns of labels that it was saved with, one value per shape, ``""`` where unknown.
    vertices, faces : tuple of ndarray
        Display meshes in file coordinates, (v, 3) and (f, 3); none before the result is saved.
    places : tuple of ndarray of uint8
        Where all vertices have maps, a colour of each vertex of the display meshes by its place on the reference,
        alike where vertices correspond, and how sure that is (v, 4); empty for a shape without maps.
    folder : Path or None
        Where the result was loaded from.
    fresh : Made or None
        What its run knows, of a result just made; ask for ``made``.
    """

    def _repr_html_(self) -> str:
        return gallery(self)

    def report(self) -> Any:
        """Open the report, which a notebook shows in a frame and a terminal in the browser; ``path`` is its file.

        That of a result that is not saved goes when Python ends: a script that ends at once saves the result first.
        """
        return open_report(self)

    def save(
        self,
        folder: str | Path,
        *,
        report: bool = True,
        labels: Mapping[str, tuple[str, ...]] | None = None,
        run: RunOptions | None = None,
    ) -> tuple[Path, ...]:
        """Write every output into ``folder``, all or nothing, and return the paths written.

        A file there that no earlier run wrote is never overwritten or deleted.

        Parameters
        ----------
        folder : str or Path
        report : bool
            Write ``report.html`` as well.
        labels : mapping of str to tuple of str, optional
            Columns of labels, one value per shape, for the report; its notes say what they contradict.
        run : RunOptions, optional
            Processes of this machine that share the work, for instance those of the alignment; by default this one
            alone.

        Raises
        ------
        InputError
            If the folder cannot be written, holds one of the shapes, lies inside of theirs, or holds somebody else's
            file under the name of an output; or if the result was loaded.
        """
        with OutputFolder.open(folder, writer=WRITER, inputs=inputs_of(self.made.files)) as output:
            num_jobs = 1 if run is None else run.num_workers
            return save_collection(self, output, report=report, labels=labels, num_jobs=num_jobs)

    def methods(self) -> str:
        """Return a paragraph for the methods section of a paper, with figures of this result, and its references."""
        return methods_paragraph(self)

    def plot(self, shapes: Iterable[str | int] | None = None) -> Any:
        """Draw shapes before and after alignment, side by side.

        Parameters
        ----------
        shapes : iterable of str or int, optional
            Names or positions; all by default.

        Returns
        -------
        matplotlib.figure.Figure
        """
        chosen = [self.index(shape) for shape in (self.names if shapes is None else shapes)]
        return pictured(self, chosen)

    def to_trimesh(self, shapes: Iterable[str | int] | None = None) -> dict[str, Any]:
        """Return shapes in the common frame, at full resolution and as cleaned for matching.

        Parameters
        ----------
        shapes : iterable of str or int, optional
            Names or positions; all by default.

        Returns
        -------
        dict of str to trimesh.Trimesh or trimesh.PointCloud

        Raises
        ------
        InputError
            If a file is not there any more.
        """
        return self._objects(trimesh_of, shapes)

    def to_open3d(self, shapes: Iterable[str | int] | None = None) -> dict[str, Any]:
        """Return shapes in the common frame as objects of Open3D, as :meth:`to_trimesh` does.

        Parameters
        ----------
        shapes : iterable of str or int, optional
            Names or positions; all by default.

        Returns
        -------
        dict of str to open3d.geometry.TriangleMesh or open3d.geometry.PointCloud

        Raises
        ------
        UnavailableError
            If Open3D cannot be imported: it is installed by ``pip install 'collalign[open3d]'``.
        InputError
            If a file is not there any more.
        """
        return self._objects(open3d_of, shapes)

    def _objects(
        self, convert: Callable[[Shape], Any], shapes: Iterable[str | int] | None
    ) -> dict[str, Any]:
        chosen = [self.index(shape) for shape in (self.names if shapes is None else shapes)]
        return {self.names[at]: convert(self.shape_at(at, aligned=True)) for at in chosen}

    def select(self, *, right: float = 0.99) -> Selection:
        """Return the shapes to keep so that a share of their poses is expected to be right.

        The share comes from how often poses that were stated so surely were right in the development sets.

        Parameters
        ----------
        right : float
            The share, between 0 and 1. As many shapes as possible are kept, the surest first.

        Returns
        -------
        Selection
            Its text says how many shapes it keeps, and what share of them is expected to be right.

        Raises
        ------
        OptionsError
            If it is no share.
        """
        return select_right(self, right)

    def to_dataframe(self, of: Literal["shapes", "pairs"] = "shapes") -> Any:
        """Return a ``pandas.DataFrame`` with one row per shape, or per matched pair."""
        import pandas

        check_choice("of", of, ("shapes", "pairs"))
        return pandas.DataFrame(list(self if of == "shapes" else self.pairs))
