"""Pages and pictures that need nothing else: plain HTML of one file, and figures that notebooks show."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from data_tools.io.files import write_atomic

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
_POLICY = "default-src 'none'; script-src 'none'; style-src 'unsafe-inline'; img-src data:"


def write_html_page(path: Path | str, title: str, body: str) -> Path:
    """Write a self-contained page.

    Parameters
    ----------
    path : Path or str
    title : str
        Plain text: window title and heading.
    body : str
        HTML below the heading; texts of users are escaped already.

    Returns
    -------
    Path
    """
    return write_atomic(Path(path), html_page(title, body))


def html_page(title: str, body: str, *, head: str = "") -> bytes:
    """Return a self-contained page as UTF-8.

    Parameters
    ----------
    title, body : str
        As of :func:`write_html_page`.
    head : str
        HTML that goes into the head.
    """
    words = html.escape(title)
    page = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}"><meta name="color-scheme" content="light dark">
{head}<title>{words}</title><style>{_STYLE}</style></head><body>
<h1>{words}</h1>
{body}
</body></html>
"""
    return page.encode("utf-8", "backslashreplace")


def html_figure(png: bytes, caption: str) -> str:
    """Return a picture with its caption, plain text, which describes it as well."""
    data, text = base64.b64encode(png).decode("ascii"), html.escape(caption)
    return f'<figure><img src="data:image/png;base64,{data}" alt="{text}"><figcaption>{text}</figcaption></figure>\n'


def html_table(name: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table that scrolls in its own frame; all texts are plain.

    Parameters
    ----------
    name : str
        What it holds, for readers that do not see it.
    columns : sequence of str
    rows : sequence of sequence of str
        As many cells as columns.
    """
    head = "".join(f'<th scope="col">{html.escape(column)}</th>' for column in columns)
    lines = "".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{html.escape(name)}">'
        f"<table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table></div>"
    )


if TYPE_CHECKING:
    from matplotlib.figure import Figure


def new_figure(**options: Any) -> Figure:
    """Return a figure without pyplot, which keeps no list of it; a cell of a notebook that ends with it shows it.

    Parameters
    ----------
    **options
        As :class:`matplotlib.figure.Figure` takes them.
    """
    return _figure_class()(**options)


@cache
def _figure_class() -> Any:
    from matplotlib.figure import Figure

    class SelfShowingFigure(Figure):
        """A figure that IPython can draw before anybody has imported pyplot."""

        def _repr_png_(self) -> bytes:
            buffer = BytesIO()
            self.savefig(buffer, format="png")
            return buffer.getvalue()

    return SelfShowingFigure
