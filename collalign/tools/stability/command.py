"""``collalign stability``: what stays when the alignment is repeated otherwise."""

from __future__ import annotations

import html
import io
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from collalign.console.interruption import resumable
from collalign.console.messages import say, say_files
from collalign.console.running import Run
from collalign.engine.run_options import RunOptions
from collalign.output.loading import load
from collalign.output.write import REPORT_FILE
from collalign.products.trust import DOUBT
from collalign.tools.stability.run import Stability, StabilityOptions, check_stability
from collalign.wording import note_text
from data_tools.arrays import FloatArray, IntArray
from data_tools.html_pages import html_figure, html_table, new_figure, write_html_page
from data_tools.io.output_folder import OutputFolder
from data_tools.io.source import inputs_of
from data_tools.notes import listed, percent

#: The command whose files these are, in the manifest of an output folder.
WRITER = "stability"
CSV_FILE, PAGE_FILE = FILES = ("stability.csv", "stability.html")
_TITLES = {
    "shape": "shape",
    "confidence": "confidence",
    "repetitions": "repetitions",
    "pose_stays": "pose stays",
    "chirality_stays": "mirror image stays",
    "largest_deg": "largest change, deg",
    "left_out": "does not count",
}
_COLUMNS = tuple(_TITLES)
#: Shapes drawn, the least stable ones.
_MAX_DRAWN = 60


def write_stability(stability: Stability, output: OutputFolder) -> tuple[Path, ...]:
    """Write ``stability.csv`` and ``stability.html`` and return the paths.

    Parameters
    ----------
    stability : Stability
    output : OutputFolder
        Usually that of the result.

    Raises
    ------
    InputError
        If somebody else's file is in the way; nothing has been written then.
    """
    output.stage_table(_rows(stability), CSV_FILE)
    write_stability_page(stability, draw_stability(stability), output.stage(PAGE_FILE))
    return output.publish(complete=True)


def stability_summary(stability: Stability) -> tuple[str, ...]:
    """Return what came out, a sentence each: the verdict first."""
    names, poses = stability.names, stability.pose_stays
    doubted = ~(stability.confidence >= DOUBT)
    compared = least_stable(stability)
    moved = [i for i in compared if poses[i] < 1.0]
    chosen = stability.who.chosen
    counted = np.intersect1d(chosen, compared)
    worst = listed([f"{names[i]} ({percent(poses[i])})" for i in moved])
    lines = [
        f"{int((poses[counted] == 1.0).sum())} of {len(counted)} poses stayed within {stability.stay_deg:.0f} deg of "
        "the others' in every repetition.",
        f"{len(names)} shapes aligned again {len(stability.repetitions)} times: {'; '.join(stability.repetitions)}.",
        f"Poses stayed in {_percent(poses[chosen])} of the repetitions, and reflections in "
        f"{_percent(stability.chirality_stays[chosen])}.",
    ]
    if moved:
        sure = sum(not doubted[i] for i in moved)
        lines.insert(1, f"Least stable, look at them first: {worst}.")
        lines.append(f"Of the {len(moved)} shapes that moved, {sure} had not been called doubtful.")
    if stability.who.left_out:
        lines += map(note_text, stability.who.notes)
    if doubted.any():
        still = sum(poses[i] == 1.0 for i in np.flatnonzero(doubted))
        lines.append(f"Of the {int(doubted.sum())} doubtful shapes {still} never moved.")
    return tuple(lines)


def write_stability_page(stability: Stability, plot: bytes, path: Path) -> Path:
    """Write the page with the summary, the table of all shapes, those that stay least first, and the plot.

    Parameters
    ----------
    stability : Stability
    plot : bytes
        The picture of :func:`draw_stability`, as PNG.
    path : Path
    """
    order = least_stable(stability).tolist()
    never = sorted(set(range(len(stability.names))) - set(order))
    cells = [dict(zip(_COLUMNS, row, strict=True)) for row in _rows(stability)[1:]]
    rows = [[_cell(column, cells[i][column]) for column in _COLUMNS] for i in (*order, *never)]
    lines = "".join(f"<li>{html.escape(line)}</li>" for line in stability_summary(stability))
    table = html_table("Stability of every shape", [_TITLES[column] for column in _COLUMNS], rows)
    drawn = "Change of every pose in every repetition, the least stable shapes first"
    back = f'<p><a href="{REPORT_FILE}">The report of this result</a></p>'
    body = f"<ul>{lines}</ul>\n{back}\n{table}\n{html_figure(plot, drawn)}"
    return write_html_page(path, "How stable the poses are", body)


def _cell(column: str, value: object) -> str:
    """Return a number of a table as it is read: shares as percentages, angles as whole degrees."""
    if not isinstance(value, float | np.floating):
        return str(value)
    if np.isnan(value):
        return "–"
    return f"{value:.0f}" if column == "largest_deg" else percent(float(value))


def least_stable(stability: Stability) -> IntArray:
    """Return the shapes whose pose was compared, those that stay least first, shape (n,)."""
    poses = stability.pose_stays
    order = np.argsort(poses, kind="stable")
    return np.asarray(order[~np.isnan(poses[order])])


def draw_stability(stability: Stability) -> bytes:
    """Draw the change of every shape's pose in every repetition, the least stable shapes first, as PNG."""
    chosen, num = least_stable(stability)[:_MAX_DRAWN], len(stability.repetitions)
    figure = new_figure(
        figsize=(3.5 + 0.55 * num, max(3.6, 2.0 + 0.2 * len(chosen))), layout="constrained"
    )
    axes = figure.subplots()
    axes.set_facecolor("lightgrey")
    image = axes.imshow(
        stability.changes_deg[:, chosen].T,
        cmap="viridis",
        vmin=0,
        vmax=stability.stay_deg,
        aspect="auto",
    )
    for column, row in zip(*np.nonzero(~stability.same_chirality[:, chosen]), strict=True):
        axes.text(column, row, "reflected", ha="center", va="center", fontsize=6, color="tab:red")
    words = [f"{stability.names[i]}  {100 * stability.pose_stays[i]:.0f} %" for i in chosen]
    for label in axes.set_yticks(range(len(chosen)), words, fontsize=7):
        label.label1.set_parse_math(False)
    axes.set_xticks(range(num), stability.repetitions, rotation=60, ha="right", fontsize=7)
    axes.set_title(
        f"Poses that stay within {stability.stay_deg:.0f} deg, of all repetitions", fontsize=9
    )
    bar = figure.colorbar(image, ax=axes)
    bar.set_label(
        f"change of pose, deg ({stability.stay_deg:.0f}: that or more; grey: took no part)",
        fontsize=8,
    )
    content = io.BytesIO()
    figure.savefig(content, format="png", metadata={"Software": None})
    return content.getvalue()


def _rows(stability: Stability) -> list[tuple[object, ...]]:
    """Return heading and one row per shape."""
    counts = stability.known.sum(axis=0).tolist()
    changes = np.where(np.isnan(stability.changes_deg), -1.0, stability.changes_deg).max(axis=0)
    reasons = dict(stability.who.left_out)
    columns = (
        stability.names,
        stability.confidence.tolist(),
        counts,
        stability.pose_stays.tolist(),
        stability.chirality_stays.tolist(),
        np.where(changes < 0, np.nan, changes).tolist(),
        [reasons.get(name, "") for name in stability.names],
    )
    return [_COLUMNS, *zip(*columns, strict=True)]


def _percent(shares: FloatArray) -> str:
    """Return the mean of the known shares in words."""
    return percent(float(np.nanmean(shares))) if np.isfinite(shares).any() else "no comparison"


def stability(
    result: Path,
    *,
    options: Annotated[StabilityOptions, Parameter(name="*")] = StabilityOptions(),  # noqa: B008
    run: Run = RunOptions(),  # noqa: B008
) -> int:
    """Repeat an alignment with other points, seeds and fewer shapes, and say which poses stay.

    Parameters
    ----------
    result
        Folder that ``collalign align`` wrote; stability.html and .csv are written into it.
    """
    collection = load(result)
    files = inputs_of(collection.source_files())
    with (
        resumable(run, result) as run,
        OutputFolder.open(result, writer=WRITER, inputs=files) as output,
    ):
        output.refuse_foreign(FILES)
        found = check_stability(collection, options=options, run=run)
        written = write_stability(found, output)
    for line in stability_summary(found):
        say(line)
    say_files(written)
    return 0
