"""The page of a transfer: every specimen with its landmarks, which a person flags, confirms, drags and downloads."""

from __future__ import annotations

import hashlib
import html
import shlex
from pathlib import Path

import numpy as np

from collalign.output.collection import Collection
from collalign.output.evidence.gather import json_types
from collalign.output.report.content import shapes_content
from collalign.output.report.page import opener, render_page
from collalign.output.report.shown import shown_part
from collalign.tools.transfer.result import TransferredLandmarks
from collalign.wording import note_text
from data_tools.io.coordinate_systems import declared_system
from data_tools.percent import MAX_NAMED

PAGE_FILE = "landmarks.html"


def landmarks_page(collection: Collection, found: TransferredLandmarks, result: Path, to: Path) -> str:
    """Return the page as HTML text, with the command of the next transfer from ``result`` into ``to``.

    Of a large collection it shows the shapes that the report shows; curves and patches are left to what slides them.
    """
    shown = shown_part(collection)
    document, blobs = shapes_content(shown)
    rows = [collection.index(name) for name in shown.names]
    along = {row for one in found.semilandmarks for row in one.rows}
    chosen = [row for row in range(len(found.labels)) if row not in along]
    words = ["collalign", "transfer", str(result), "--landmarks", "templates.csv", "--to", str(to)]
    document["kind"] = "landmarks"
    document["run"] += hashlib.sha256(np.nan_to_num(found.points).tobytes()).hexdigest()[:16]
    document["landmarks"] = {
        "labels": [found.labels[row] for row in chosen],
        "points": found.points[np.ix_(rows, chosen)],
        "radii": found.radii[np.ix_(rows, chosen)],
        "status": [[found.status[at][row] for row in chosen] for at in rows],
        "systems": [(declared_system(Path(file)) if file else None) or found.system for file in shown.files],
        "command": shlex.join(words),
    }
    lacking = np.isnan(found.points[:, chosen]).any(axis=2).sum(axis=1)
    doubted = np.argsort(-lacking, kind="stable")[: int((lacking > 0).sum())]
    named = ", ".join(opener(found.names[at]) for at in doubted[:MAX_NAMED] if found.names[at] in shown.names)
    said = f"{len(found.names) - len(doubted)} of {len(found.names)} specimens have all {len(chosen)} landmarks."
    summary = f'<p class="verdict {"warn" if named else "plain"}">{said}{f" Look at: {named}." if named else ""}</p>'
    notes = dict.fromkeys(map(note_text, (*found.notes, *collection.notes)))
    items = "".join(f"<li>{html.escape(note)}</li>" for note in notes)
    summary += f'<ul class="notes">{items}</ul>' if items else ""
    version = str(collection.run.versions.get("collalign", ""))
    return render_page("Landmarks", summary, dict(json_types(document)), blobs, version=version)
