"""What a notebook shows of a collection, and where its report is opened."""

from __future__ import annotations

import base64
import html
import sys
import webbrowser
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

from collalign.output.collection_data import CollectionData
from collalign.output.contact_sheet import contact_sheet, tile_of
from collalign.output.evidence.gather import shown_pair
from collalign.output.report.page import report_pages, write_report
from collalign.output.report.shown import some_shapes
from collalign.output.views import FEWEST_FACES, display_mesh
from collalign.products.named_frame import NamedFrame
from collalign.products.trust import DOUBT
from data_tools.arrays import IntArray
from data_tools.errors import CollalignError
from data_tools.percent import percent

#: Shapes that a notebook shows by itself.
_MOST_SHOWN = 12


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
        path = write_report(_part(collection, np.arange(len(collection))), mkdtemp(prefix="collalign-"))
    if "ipykernel" not in sys.modules:
        webbrowser.open(path.absolute().as_uri())
    return ReportView(path)


def gallery(collection: CollectionData) -> str:
    """Return HTML of the least sure shapes: by name if in doubt, in a frame, and in a picture for where none is."""
    order = np.argsort(np.nan_to_num(collection.confidence), kind="stable")[:_MOST_SHOWN]
    rows = [
        f"<tr><td>{html.escape(one.name)}</td><td>{percent(one.confidence)}</td></tr>"
        for one in (collection[at] for at in order.tolist())
        if not one.confidence >= DOUBT
    ]
    table = f"<table><tr><th>In doubt</th><th>Confidence</th></tr>{''.join(rows)}</table>" if rows else ""
    told = f"<p>{html.escape(repr(collection)[1:-1])}</p>{table}"
    try:
        part, title = _part(collection, np.sort(order)), f"The {len(order)} least sure of {len(collection)} shapes"
        page = replace(next(report_pages(part, Path("report.html"), title=title)), summary="", again=None)
        picture = base64.b64encode(pictured(collection, np.sort(order).tolist())._repr_png_()).decode()
    except CollalignError:  # a file is not there any more
        return told
    image = f'<img alt="Before and after" style="max-width:100%" src="data:image/png;base64,{picture}">'
    return f"{told}{_framed(page.text())}<details><summary>As a picture</summary>{image}</details>"


def pictured(collection: CollectionData, chosen: Iterable[int]) -> Any:
    """Return the figure of matplotlib with some shapes, given by position, before and after alignment."""
    confidence, transforms = collection.confidence, collection.transforms
    tiles = (tile_of(collection.shape_at(at), transforms[at], float(confidence[at])) for at in chosen)
    return contact_sheet(tiles, NamedFrame.of(collection.options))


def _part(collection: CollectionData, chosen: IntArray) -> CollectionData:
    """Return some shapes of a collection, with meshes to look at."""
    meshes = [
        display_mesh(one.vertices, one.faces, max_faces=FEWEST_FACES)
        for one in map(collection.shape_at, chosen.tolist())
    ]
    vertices, faces = zip(*meshes, strict=True)
    part = some_shapes(replace(collection, vertices=(), faces=(), places=()), chosen)
    return replace(part, vertices=vertices, faces=faces, pairs=[shown_pair(pair) for pair in part.pairs])


def _framed(page: str) -> str:
    """Return a page, which may come from anybody, in a frame that only runs its scripts and downloads."""
    may = 'sandbox="allow-scripts allow-downloads" allow="clipboard-write"'
    look = 'title="Report" style="width:100%;height:40rem;border:1px solid #8888"'
    return f'<iframe {may} {look} srcdoc="{html.escape(page)}"></iframe>'
