"""What a person does with a result in a notebook: look at it, tabulate it, and take its aligned meshes."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from collalign.products.pair import Alternative, Pair
from collalign.products.trust import DOUBT
from data_tools.arrays import FloatArray, one_line
from data_tools.errors import CollalignError, UnavailableError
from data_tools.percent import percent
from data_tools.poses import scales_of
from data_tools.surface.shape import Shape

#: Shapes that a notebook shows by themselves, drawn and in a table.
MOST_SHOWN = 12


@dataclass(frozen=True, kw_only=True, eq=False)
class AlignedShape:
    """One shape of a result.

    Attributes
    ----------
    name, file : str
        The file is empty where the shape came from memory.
    transform : ndarray, shape (4, 4)
        File coordinates to the common frame.
    reflected : bool
    confidence : float
        NaN where it is not known.
    part : int
        Shapes of different parts are not aligned with each other.
    alternatives : tuple of Alternative
        Other poses, the likeliest first.
    """

    name: str
    file: str
    transform: FloatArray
    reflected: bool
    confidence: float
    part: int
    alternatives: tuple[Alternative, ...]

    __repr__ = one_line


def html_of(words: str, shapes: Sequence[AlignedShape], plot: Callable[[list[str | int]], Any]) -> str:
    """Return the least confident shapes as HTML, before and after, and in a table; without their files a sentence."""
    known = np.array([shape.confidence for shape in shapes])
    order = np.argsort(np.where(np.isnan(known), 2.0, known), kind="stable")[:MOST_SHOWN].tolist()
    rest = f"<p>The {len(order)} of least confidence of {len(shapes)} shapes.</p>" if len(order) < len(shapes) else ""
    stream = io.BytesIO()
    try:
        plot(sorted(order)).savefig(stream, format="png")
        data = base64.b64encode(stream.getvalue()).decode("ascii")
        picture = f'<img alt="Shapes before and after alignment" src="data:image/png;base64,{data}">'
    except CollalignError as error:
        picture = f"<p>No picture: {html.escape(str(error))}</p>"
    rows = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in _cells(shapes[at]))}</tr>" for at in order)
    table = f"<table><thead><tr><th>shape</th><th>confidence</th><th></th></tr></thead><tbody>{rows}</tbody></table>"
    return f"<p>{html.escape(words)}</p>{picture}{table}{rest}"


def _cells(shape: AlignedShape) -> tuple[str, str, str]:
    row = _shape_row(shape)
    said = ", ".join(word for word in ("doubtful", "mirrored") if row[word])
    return html.escape(shape.name), percent(shape.confidence), said


def trimesh_of(shape: Shape) -> Any:
    """Return a shape as ``trimesh.Trimesh``, or ``trimesh.PointCloud`` where it has no faces."""
    import trimesh

    if not shape.is_mesh:
        return trimesh.PointCloud(shape.vertices.copy())
    return trimesh.Trimesh(shape.vertices.copy(), shape.faces.copy(), process=False)


def shapes_table(shapes: Iterable[AlignedShape]) -> Any:
    """Return a pandas.DataFrame with a row per shape."""
    return _table([_shape_row(shape) for shape in shapes]).set_index("name")


def pairs_table(pairs: Iterable[Pair], names: Sequence[str]) -> Any:
    """Return a pandas.DataFrame with a row per pair."""
    columns = ["target", "source", *_PAIR_FIELDS]
    rows = [
        [names[pair.target], names[pair.source], *(getattr(pair, name) for name in _PAIR_FIELDS)] for pair in pairs
    ]
    return _table(rows, columns=columns).set_index(["target", "source"])


def _table(rows: Sequence[Any], **how: Any) -> Any:
    try:
        import pandas
    except ImportError as error:
        raise UnavailableError(
            "to_dataframe needs pandas; install it with: pip install 'collalign[tables]'"
        ) from error
    return pandas.DataFrame(rows, **how)


_PAIR_FIELDS = ("energy", "lower_bound", "status", "chirality_proven", "choice", "inlier", "disagreement_deg")


def _shape_row(shape: AlignedShape) -> dict[str, Any]:
    return {
        "name": shape.name,
        "file": shape.file,
        "confidence": shape.confidence,
        "doubtful": not shape.confidence >= DOUBT,
        "mirrored": shape.reflected,
        "scale": float(scales_of(shape.transform)),
        "part": shape.part,
        "alternatives": len(shape.alternatives),
    }
