"""Fills the page's template: everything inside one file that opens from disk without a network.

A browser holds some hundreds of shapes, and collections have thousands. The first page shows the most doubtful shapes
and others evenly spaced. All shapes are on further pages, each with shapes that were compared with each other.
"""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from collalign.output.collection_data import CollectionData
from collalign.output.provenance import option_words, shape_words
from collalign.output.report.content import build_content
from collalign.products.run_record import RunRecord
from collalign.products.trust import DOUBT
from collalign.wording import note_text
from data_tools.arrays import IntArray
from data_tools.errors import CollalignError
from data_tools.notes import MAX_NAMED, Note, percent
from data_tools.threads import one_blas_thread

#: Most shapes of a page. With so many it opens in seconds; matrix, map and tree grow with their square.
MOST_ON_PAGE = 600


def shown_part(collection: CollectionData) -> CollectionData:
    """Return the collection as far as a page shows it: all of it, or some shapes with a note that says so."""
    if len(collection) <= MOST_ON_PAGE:
        return collection
    numbers = {"num": MOST_ON_PAGE, "total": len(collection), "num_doubtful": MOST_ON_PAGE // 2}
    part = collection.some(chosen_shapes(collection, MOST_ON_PAGE))
    return replace(part, notes=(*collection.notes, Note("shown-in-part", values=numbers)))


def page_members(collection: CollectionData) -> list[IntArray]:
    """Return the shapes, each (n,), of the pages that show all: about as many on each, most pairs within a page.

    Shapes are ordered so that those that were matched and agree are near each other (Cuthill and McKee 1969).
    """
    num = len(collection)
    agreeing = [(pair.target, pair.source) for pair in collection.pairs if pair.inlier]
    ends = np.array(agreeing, dtype=np.int64).reshape(-1, 2)
    rows, cols = np.concatenate([ends, ends[:, ::-1]]).T
    graph = scipy.sparse.coo_array((np.ones(len(rows)), (rows, cols)), shape=(num, num)).tocsr()
    order = scipy.sparse.csgraph.reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.int64)
    num_pages = -(-num // MOST_ON_PAGE)
    return [np.sort(members) for members in np.array_split(order, num_pages)]


def chosen_shapes(collection: CollectionData, most: int) -> IntArray:
    """Return positions of the least confident shapes, half of ``most``, and of others evenly spaced, (most,)."""
    order = np.argsort(np.nan_to_num(collection.confidence), kind="stable")
    doubtful, others = order[: most // 2], np.sort(order[most // 2 :])
    spaced = others[np.linspace(0, len(others) - 1, most - len(doubtful)).round().astype(np.int64)]
    return np.sort(np.concatenate([doubtful, spaced]))


#: Folder next to the report with the pages that show all shapes of a large collection.
PAGES_FOLDER = "report_pages"

_MARKER = re.compile(r"\{\{(\w+)\}\}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Page:
    """One page of a report, as it goes to the worker that writes it.

    Attributes
    ----------
    path : Path
    title : str
    summary : str
        HTML below the title.
    shown : CollectionData
        What the page shows.
    again : tuple of str or None
        The words of the command that makes the result again, but its folder; None where none does.
    """

    path: Path
    title: str
    summary: str
    shown: CollectionData
    again: tuple[str, ...] | None

    def text(self) -> str:
        """Return the page as HTML text."""
        document, blobs = build_content(self.shown)
        document["again"] = self.again
        version = str(self.shown.run.versions.get("collalign", ""))
        return render_page(self.title, self.summary, document, blobs, version=version)

    def write(self) -> None:
        """Write the page; the folder of further pages is made."""
        self.path.parent.mkdir(exist_ok=True)
        self.path.write_text(self.text(), encoding="utf-8", errors="backslashreplace", newline="\n")


@one_blas_thread()
def write_report(
    collection: CollectionData, path: Path | str, *, title: str = "Aligned collection"
) -> Path:
    """Write a self-contained ``report.html``; of a large collection also pages with all shapes, next to it.

    Parameters
    ----------
    collection : CollectionData
    path : path
        The file to write, or a folder that receives ``report.html``.
    title : str
        Heading of the page.

    Returns
    -------
    Path
        The file written; the same collection gives the same bytes.
    """
    target = Path(path)
    if target.suffix.lower() not in (".html", ".htm"):
        target.mkdir(parents=True, exist_ok=True)
        target = target / "report.html"
    for page in report_pages(collection, target, title=title):
        page.write()
    return target


def report_pages(collection: CollectionData, path: Path, *, title: str) -> Iterator[Page]:
    """Yield the page of a report, and of a large collection the further pages that show all shapes.

    Parameters
    ----------
    collection : CollectionData
    path : Path
        Of the first page.
    title : str
    """
    # Pages say nothing that differs between two runs with the same result: that is in run.json.
    collection = replace(collection, run=RunRecord(versions=collection.run.versions))
    shown, again = shown_part(collection), _again(collection)
    pages = page_members(collection) if len(collection) > MOST_ON_PAGE else []
    every = _every_shape(collection, pages) if pages else ""
    yield Page(
        path=path,
        title=title,
        summary=_summary(collection, shown.notes) + every,
        shown=shown,
        again=again,
    )
    for number, members in enumerate(pages, 1):
        shown = collection.some(members)
        summary = f"{_steps(number, len(pages), path.name)}{_summary(shown, ())}"
        place = path.parent / page_path(number)
        yield Page(
            path=place, title=f"{title}, page {number}", summary=summary, shown=shown, again=again
        )


def page_path(number: int) -> str:
    """Return where one of the pages with all shapes of a large collection lies, relative to the report."""
    return f"{PAGES_FOLDER}/page-{number:03d}.html"


def _again(collection: CollectionData) -> tuple[str, ...] | None:
    try:
        words, left_out = shape_words(collection)
    except (CollalignError, OSError):
        return None
    return (*words, *option_words(collection.options), *(f"--exclude={name}" for name in left_out))


def _every_shape(collection: CollectionData, pages: list[IntArray]) -> str:
    """Return the list of all shapes by name, each with a link to the page that shows it."""
    number = np.empty(len(collection), dtype=np.int64)
    for at, members in enumerate(pages, 1):
        number[members] = at
    items = [
        f'<li><a href="{page_path(int(number[i]))}">{html.escape(name)}</a> {percent(collection.confidence[i])}</li>'
        for i, name in enumerate(collection.names)
    ]
    return (
        f'<details class="every"><summary>All {len(collection)} shapes, on {len(pages)} more pages in the folder '
        f"{PAGES_FOLDER}: each shows shapes that were compared with each other. The browser's search finds names."
        f"</summary><div tabindex='0'><ul>{''.join(items)}</ul></div></details>"
    )


def _steps(number: int, num_pages: int, report: str) -> str:
    """Return the links from one of the further pages to the others."""
    places = {f"../{html.escape(report)}": "overview"}
    if number > 1:
        places[Path(page_path(number - 1)).name] = "page before"
    if number < num_pages:
        places[Path(page_path(number + 1)).name] = "next page"
    links = ", ".join(f'<a href="{place}">{words}</a>' for place, words in places.items())
    return f"<p>Page {number} of {num_pages}; its decisions are downloaded from this page. Go to: {links}</p>"


def render_page(
    title: str, summary: str, document: dict[str, Any], blobs: dict[str, str], *, version: str = ""
) -> str:
    """Return a page of the viewer as HTML text; which one it is, the document says.

    Parameters
    ----------
    title : str
    summary : str
        HTML below the title.
    document : dict
        JSON types only.
    blobs : dict of str to str
        Base64 text by the element's id.
    version : str
        Of the toolkit, for the last line.
    """
    elements = [_element("collalign-data", "application/json", _json_for_html(document))]
    elements += [_element(name, "text/plain", text) for name, text in blobs.items()]
    parts = {
        "title": html.escape(title),
        "style": _asset("viewer/style.css"),
        "summary": summary,
        "version": html.escape(version),
        "data": "\n".join(elements),
        "script": _asset("viewer.min.js").replace("</script", "<\\/script"),
    }
    return _MARKER.sub(lambda match: parts[match.group(1)], _asset("viewer/template.html"))


def _asset(name: str) -> str:
    return resources.files("collalign.output.report").joinpath(name).read_text(encoding="utf-8")


def _element(name: str, kind: str, text: str) -> str:
    return f'<script type="{kind}" id="{html.escape(name, quote=True)}">{text}</script>'


def _json_for_html(document: object) -> str:
    """JSON in which no name from a file can close the element or open a comment."""
    text = json.dumps(document, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _summary(collection: CollectionData, notes: tuple[Note, ...]) -> str:
    """Return what a reader sees first: what to look at and what is missing in the whole collection; then the rest."""
    order = np.argsort(np.nan_to_num(collection.confidence), kind="stable").tolist()
    doubtful = [collection.names[at] for at in order if collection.is_doubtful[at]]
    num_parts = len(np.unique(collection.part_numbers[~collection.is_alone]))
    num_sure = int((collection.confidence >= DOUBT).sum())
    words = [f"{num_sure} of {int((~collection.is_alone).sum())} poses are sure."]
    if collection.by_hand:
        by_hand = ", ".join(map(opener, [*collection.by_hand][:MAX_NAMED]))
        more = " and others" if len(collection.by_hand) > MAX_NAMED else ""
        words[0] = (
            f"{words[0].rstrip('.')}, {len(collection.by_hand)} of them set by hand ({by_hand}{more})."
        )
    if doubtful:
        more = (
            f' and <a href="#confidence">{len(doubtful) - MAX_NAMED} more</a>'
            if doubtful[MAX_NAMED:]
            else ""
        )
        words.append(f"Look at: {', '.join(map(opener, doubtful[:MAX_NAMED]))}{more}.")
    if num_parts > 1:
        words.append(f"The shapes form {num_parts} parts that are not surely joined.")
    if collection.excluded:
        num = len(collection.excluded)
        words.append(f'<a href="#excluded">{num} {"file" if num == 1 else "files"} left out</a>.')
    kind = "warn" if len(words) > 1 else "plain"
    if kind == "plain":
        words.append("Nothing was left out, and nothing needs to be looked at.")
    against = sum(not pair.inlier for pair in collection.pairs)
    num_incomplete = sum(not one.is_stranger for one in collection.incomplete)
    incomplete = f", {num_incomplete} of them incomplete" if num_incomplete else ""
    facts = [
        (len(collection), f"shapes aligned{incomplete}"),
        (int(collection.reflected.sum()), "of them reflected"),
        (len(collection.pairs), f"pairs compared, {against} against the common poses"),
    ]
    items = "".join(f"<li><strong>{value}</strong>{said}</li>" for value, said in facts)
    rest = [note_text(note) for note in notes if note.code != "doubtful"]  # named above
    listed = "".join(f"<li>{html.escape(text)}</li>" for text in rest)
    noted = f'<ul class="notes">{listed}</ul>' if listed else ""
    return f'<p class="verdict {kind}">{" ".join(words)}</p><ul class="facts">{items}</ul>{noted}'


def opener(name: str) -> str:
    """Return a button of the report that opens the dialog of a shape."""
    return f'<button type="button" class="link" data-shape="{html.escape(name)}">{html.escape(name)}</button>'
