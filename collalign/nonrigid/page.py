"""The report of a non-rigid match: one HTML file with the coloured shapes, the runners-up and their scores."""

from __future__ import annotations

import base64
import html
import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from collalign.nonrigid.pictures import draw_match
from collalign.nonrigid.result import NonrigidCandidate, NonrigidMatch
from data_tools.arrays import IntArray
from data_tools.io.files import write_atomic
from data_tools.percent import percent
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread

#: Runners-up that are drawn.
MAX_DRAWN = 4

_STYLE = """
:root { color-scheme: light dark; --page: #f6f6f3; --card: #fff; --ink: #1d2126; --muted: #5c6670; --line: #dcdcd6;
  font: 16px/1.5 system-ui, sans-serif; }
@media (prefers-color-scheme: dark) {
  :root { --page: #15181c; --card: #1d2126; --ink: #e8e8e4; --muted: #a3adb7; --line: #343b43; }
  img { filter: brightness(.86); }
}
body { max-width: 75rem; margin: 0 auto; padding: 1rem; background: var(--page); color: var(--ink);
  overflow-wrap: anywhere; }
h1 { font-size: 1.7rem; line-height: 1.2; } h2 { font-size: 1.2rem; break-after: avoid; }
figure, .scroll { margin: 1rem 0; padding: .6rem; background: var(--card); border: 1px solid var(--line);
  border-radius: .5rem; break-inside: avoid; }
img { display: block; width: 100%; height: auto; background: white; border-radius: .4rem; }
figcaption { margin-top: .4rem; font-size: .9rem; color: var(--muted); }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: .2rem .8rem .2rem 0; text-align: right; border-bottom: 1px solid var(--line);
  overflow-wrap: normal; }
th:first-child, td:first-child { text-align: left; overflow-wrap: anywhere; }
@media (max-width: 40rem) { body { padding: .7rem; } th, td { padding-right: .4rem; font-size: .85rem; } }
@media print { :root { color-scheme: light; --page: #fff; --card: #fff; --ink: #000; --muted: #444; }
  img { filter: none; } }
"""
#: As in report.html: nothing is loaded, nothing is sent; here nothing runs either.
_POLICY = "default-src 'none'; script-src 'none'; style-src 'unsafe-inline'; img-src data:"


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
    figures = [_figure("The chosen map", target, source, chosen)]
    for rank, candidate in enumerate(match.candidates[1 : 1 + MAX_DRAWN], start=2):
        caption = f"Candidate {rank}: {candidate.origin}, orientation {candidate.orientation}"
        figures.append(
            _figure(caption, target, source, vertices_map(_spread(match, candidate, source), target, source))
        )
    title = html.escape(f"{match.source_name} on {match.target_name}")
    notes = "".join(f"<li>{html.escape(note)}</li>" for note in match.notes)
    page = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}"><meta name="color-scheme" content="light dark">
<title>{title}</title><style>{_STYLE}</style></head><body>
<h1>{title}</h1>
<p>Equal colours correspond. Confidence {percent(match.confidence)}; orientation {html.escape(match.orientation)};
{match.bijectivity:.0%} of the samples come back near themselves by map and inverse.
{html.escape(match.status.value)}</p>
<ul>{notes}</ul>
{figures[0]}
<h2>Candidates</h2>
{_table(match)}
{"".join(figures[1:])}
</body></html>
"""
    return write_atomic(Path(path), page.encode("utf-8"))


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


def _figure(caption: str, target: Shape, source: Shape, point_map: IntArray) -> str:
    with tempfile.TemporaryDirectory() as folder:
        picture = draw_match(Path(folder) / "map.png", target, source, point_map).read_bytes()
    data = base64.b64encode(picture).decode("ascii")
    text = html.escape(caption)
    return f'<figure><img src="data:image/png;base64,{data}" alt="{text}"><figcaption>{text}</figcaption></figure>\n'


def _table(match: NonrigidMatch) -> str:
    columns = ("origin", "score (lower is better)", "orientation", "energy")
    head = "<tr>" + "".join(f'<th scope="col">{column}</th>' for column in columns) + "</tr>"
    rows = "".join(
        f"<tr><td>{html.escape(c.origin)}</td><td>{c.evidence.score:.3f}</td>"
        f"<td>{html.escape(c.orientation)}</td><td>{c.energy:.3f}</td></tr>"
        for c in match.candidates
    )
    return (
        '<div class="scroll" tabindex="0" role="region" aria-label="Candidates">'
        f"<table><thead>{head}</thead><tbody>{rows}</tbody></table></div>"
    )
