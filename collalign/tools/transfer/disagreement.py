"""What templates disagree on, as tables and as a picture."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from collalign.engine.command_line import json_types
from collalign.output.collection import Collection
from collalign.output.views import BONE_COLOUR, camera, cell_places, draw_panels, seen_panel
from collalign.products.named_frame import NamedFrame
from collalign.tools.transfer.result import TransferredLandmarks
from collalign.wording import note_records
from data_tools.html_pages import new_figure
from data_tools.notes import Note
from data_tools.poses import moved_by

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Templates that the picture shows, and landmarks of each that are called by name.
_MOST_PANELS, _MOST_NAMED = 6, 12
#: In inches: of a surface, and of a row of the chart.
_PANEL, _ROW = 4.0, 0.25
#: Times the median disagreement at which the colours of the chart end.
_WORST = 30.0


def findings(found: TransferredLandmarks) -> Iterator[tuple[str, str, str]]:
    """Yield what templates disagree on: template, landmark, and what is wrong there ("swapped?", "far", ...)."""
    for note in template_notes(found):
        labels = note.values["labels"]
        kind = f"{note.values['kind']}?" if "kind" in note.values else "far"
        for name in note.shapes:
            for label in labels if isinstance(labels, tuple) else ():
                yield name, str(label), kind


def template_notes(found: TransferredLandmarks) -> list[Note]:
    """Return the notes of what templates disagree on."""
    return [note for note in found.notes if note.code.startswith("templates-")]


def agreement_rows(found: TransferredLandmarks) -> list[list[object]]:
    """Return one row per template and landmark: its distance from where the others predict it, trust and finding."""
    wrong = {(name, label): kind for name, label, kind in findings(found)}
    rows: list[list[object]] = [["template", "landmark", "distance", "trust", "finding"]]
    for at, name in enumerate(found.templates):
        for number in _own_rows(found):
            label = found.labels[number]
            pair = found.left_out_errors[at, number], found.template_trust[at, number]
            rows.append([name, label, *map(float, pair), wrong.get((name, label), "")])
    return rows


def agreement_text(found: TransferredLandmarks) -> str:
    """Return the table and its findings as JSON; null where nothing is known."""
    rows = _own_rows(found)
    record = {
        "templates": found.templates,
        "landmarks": [found.labels[row] for row in rows],
        "distance": found.left_out_errors[:, rows],
        "trust": found.template_trust[:, rows],
        "findings": [
            {"template": name, "landmark": label, "finding": kind}
            for name, label, kind in findings(found)
        ],
        "notes": note_records(template_notes(found)),
    }
    return json.dumps(json_types(record), indent=1) + "\n"


def _own_rows(found: TransferredLandmarks) -> list[int]:
    """Return the landmarks that any template has."""
    return np.flatnonzero(
        found.template_trust.any(axis=0) | np.isfinite(found.left_out_errors).any(axis=0)
    ).tolist()


def agreement_figure(collection: Collection, found: TransferredLandmarks) -> Figure:
    """Return a picture of the templates that disagree with the others, and a chart of all.

    Red is where the template has a landmark, blue where the others predict it. The chart has the distances of all
    templates and landmarks in parts of their median.

    Parameters
    ----------
    collection : Collection
    found : TransferredLandmarks
        With a finding at least.
    """
    wrong: dict[str, dict[str, None]] = {}
    for name, label, _ in findings(found):
        wrong.setdefault(name, {})[label] = None
    shown = [*wrong][:_MOST_PANELS]
    rows = _own_rows(found)
    height = _ROW * (len(found.templates) + 4)
    width, total = _PANEL * max(len(shown), 2), _PANEL + height
    figure = new_figure(figsize=(width, total), dpi=110)
    axes = figure.add_axes(
        (0.0, height / total, len(shown) * _PANEL / width, _PANEL / total),
        xlim=(0.0, len(shown)),
        ylim=(0.0, 1.0),
    )
    axes.set_axis_off()
    view, panels, drawn = camera(_posed(collection), NamedFrame.of(collection.options)), [], []
    for column, name in enumerate(shown):
        at, corner = collection.index(name), np.array([float(column), 0.0])
        transform = collection.transforms[at]
        vertices, faces = collection.surfaces[at]
        seen = moved_by(transform, vertices) @ view.T
        flipped = bool(np.linalg.det(transform[:3, :3]) < 0)
        panels.append(seen_panel(seen, faces, corner, BONE_COLOUR, flipped=flipped))
        chosen = [found.labels.index(label) for label in wrong[name]]
        both = (found.points[at], found.left_out_points[found.templates.index(name)])
        drawn.append(
            [cell_places(moved_by(transform, one[chosen]) @ view.T, seen, corner) for one in both]
        )
    draw_panels(axes, panels)
    words: dict[str, Any] = {"fontsize": 7, "parse_math": False}
    for column, (name, (own, others)) in enumerate(zip(shown, drawn, strict=True)):
        axes.text(column + 0.03, 0.96, name, **words)
        axes.plot(
            *np.stack([own[:, :2], others[:, :2]], axis=2).transpose(1, 2, 0), color="0.2", lw=0.8
        )
        axes.plot(*others[:, :2].T, "o", ms=4, color="tab:blue")
        axes.plot(*own[:, :2].T, "o", ms=4, color="tab:red")
        for label, place in [*zip(wrong[name], own, strict=True)][:_MOST_NAMED]:
            axes.text(place[0] + 0.01, place[1] + 0.01, label, color="tab:red", **words)
    _chart(figure, found, rows, height / total)
    return figure


def _posed(collection: Collection) -> Iterator[tuple[Any, Any]]:
    for transform, (vertices, faces) in zip(
        collection.transforms, collection.surfaces, strict=True
    ):
        yield moved_by(transform, vertices), faces


def _chart(figure: Figure, found: TransferredLandmarks, rows: list[int], height: float) -> None:
    """Draw distances of templates and landmarks in parts of their median, below the surfaces."""
    errors = found.left_out_errors[:, rows]
    axes = figure.add_axes((0.16, 0.45 * height, 0.68, 0.5 * height))
    known = errors[np.isfinite(errors)]
    parts = errors / (float(np.median(known)) if known.any() else 1.0)
    image = axes.imshow(parts, aspect="auto", cmap="Reds", norm="log", vmin=1.0, vmax=_WORST)
    words: dict[str, Any] = {"fontsize": 7, "parse_math": False}
    axes.set_yticks(range(len(found.templates)), found.templates, **words)
    axes.set_xticks(range(len(rows)), [found.labels[row] for row in rows], rotation=90, **words)
    bar = figure.colorbar(image, ax=axes, fraction=0.05, pad=0.01)
    bar.set_label("times the median", fontsize=7)
