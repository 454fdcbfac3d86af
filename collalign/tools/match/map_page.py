"""The report of a non-rigid match: one HTML file with the coloured shapes, the runners-up and their scores."""

from __future__ import annotations

import html
import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from collalign.tools.match.pictures import draw_match
from collalign.tools.match.result import NonrigidCandidate, NonrigidMatch
from data_tools.arrays import FloatArray, IntArray
from data_tools.html_pages import html_figure, html_table, write_html_page
from data_tools.percent import percent
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread

#: Runners-up that are drawn.
MAX_DRAWN = 4


@one_blas_thread()
def write_match_page(path: Path | str, match: NonrigidMatch, target: Shape, source: Shape) -> Path:
    """Write a self-contained page about a match: the chosen map, its runners-up, and what speaks for each.

    Parameters
    ----------
    path : Path or str
    match : NonrigidMatch
    target, source : Shape
        The two shapes as they were read, with ``source_indices`` where vertices were dropped.

    Returns
    -------
    Path
    """
    chosen = vertices_map(match.point_map_target_source, target, source)
    trust = at_vertices(match.vertex_confidence, source)
    figures = [_figure("The chosen map", target, source, chosen, trust)]
    for rank, candidate in enumerate(match.candidates[1 : 1 + MAX_DRAWN], start=2):
        caption = f"Candidate {rank}: {candidate.origin}, orientation {candidate.orientation}"
        figures.append(
            _figure(caption, target, source, vertices_map(_spread(match, candidate, source), target, source))
        )
    notes = "".join(f"<li>{html.escape(note)}</li>" for note in match.notes)
    body = f"""<p>Equal colours correspond. Nine points in ten are in place with a probability of
{percent(match.confidence)}; the mean probability of a vertex is {percent(float(np.nanmean(trust)))}; orientation
{html.escape(match.orientation)};
{percent(match.bijectivity)} of the samples come back near themselves by map and inverse.</p>
<ul>{notes}</ul>
{figures[0]}
<h2>Candidates</h2>
{_table(match)}
{"".join(figures[1:])}"""
    return write_html_page(path, f"{match.source_name} on {match.target_name}", body)


def vertices_map(point_map_target_source: IntArray, target: Shape, source: Shape) -> IntArray:
    """Turn a map between the vertices of two files into one between the vertices of the shapes as they were read.

    Parameters
    ----------
    point_map_target_source : ndarray of int
        Vertex of the target file for each vertex of the source file, -1 where there is none.
    target, source : Shape

    Returns
    -------
    ndarray of int, shape (number of source vertices,)
    """
    of_target, of_source = (_file_indices(shape) for shape in (target, source))
    size = max(int(of_target.max()), int(point_map_target_source.max(initial=-1))) + 1
    places = np.full(size + 1, -1, dtype=np.int64)
    places[of_target] = np.arange(len(of_target))
    return places[point_map_target_source[of_source]]


def at_vertices(values: FloatArray, shape: Shape) -> FloatArray:
    """Return values of a file's vertices at the vertices of the shape as it was read, NaN where there is none."""
    return np.asarray(np.append(values, np.nan)[np.minimum(_file_indices(shape), len(values))])


def _file_indices(shape: Shape) -> IntArray:
    indices = shape.source_indices
    return np.arange(len(shape.vertices)) if indices is None else indices


def _spread(match: NonrigidMatch, candidate: NonrigidCandidate, source: Shape) -> IntArray:
    """Give every vertex of the source file the image of the nearest sample: candidates are known at samples only."""
    of_source = _file_indices(source)
    places = np.full(int(max(of_source.max(), match.dense_source.max())) + 1, -1, dtype=np.int64)
    places[of_source] = np.arange(len(of_source))
    nearest = cKDTree(source.vertices[places[match.dense_source]]).query(source.vertices)[1]
    spread = np.full(len(places), -1, dtype=np.int64)
    spread[of_source] = candidate.map_target_source[nearest]
    return spread


def _figure(
    caption: str, target: Shape, source: Shape, point_map: IntArray, confidence: FloatArray | None = None
) -> str:
    with tempfile.TemporaryDirectory() as folder:
        picture = draw_match(Path(folder) / "map.png", target, source, point_map, confidence).read_bytes()
    return html_figure(picture, caption)


def _table(match: NonrigidMatch) -> str:
    columns = ("origin", "score (lower is better)", "orientation", "energy")
    rows = [(c.origin, f"{c.evidence.score:.3f}", c.orientation, f"{c.energy:.3f}") for c in match.candidates]
    return html_table("Candidates", columns, rows)
