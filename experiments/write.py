"""Writes what an experiment found: CSV, Markdown and pictures, and the page that holds all experiments."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable
from pathlib import Path

from data_tools.io.files import write_atomic
from experiments.experiment import Bench, Experiment, Outcome, Plot
from experiments.headlines import write_headlines
from experiments.provenance import describe_versions
from experiments.seen import seen_note

#: Folder of the experiments' files, beside the page.
RESULTS = "results"
PAGE = "RESULTS.md"
_DPI = 110

_HEAD = """# Results

What `python -m experiments NAME` measured, one section per experiment; written by that command and never
edited by hand. The rows at full precision lie in `results/NAME.csv`. Times are those of the machine that each section
names; what it says of the toolkit holds for the day that it names, and not for later changes of the toolkit.

Constants of the toolkit were chosen while looking at the teeth, at SHREC07's glasses, ants, chairs, teddy bears,
humans and armadillos, and at SCAPE: figures on these are not independent (the sections Collections, Figure 13, Table
1, random starts, other tools, teeth jobs, SCAPE and SHREC07 maps). Those on mouse skulls and generated families are.
"""


def write_experiment(experiment: Experiment, outcome: Outcome, bench: Bench, folder: Path) -> list[Path]:
    """Write one experiment's files into ``folder/results``.

    Parameters
    ----------
    experiment : Experiment
    outcome : Outcome
    bench : Bench
        That it ran on.
    folder : Path

    Returns
    -------
    list of Path
        What was written; ``results/NAME.md`` is the last.
    """
    results = folder / RESULTS
    results.mkdir(parents=True, exist_ok=True)
    written = []
    for table in outcome.tables:
        written.append(write_atomic(results / f"{_stem(experiment, table.name)}.csv", table.to_csv().encode()))
    for plot in outcome.plots:
        written.append(write_atomic(results / f"{_stem(experiment, plot.name)}.png", _png(plot)))
    written.append(write_atomic(results / f"{experiment.name}.md", _section(experiment, outcome, bench).encode()))
    return written


def write_page(names: Iterable[str], folder: Path) -> Path:
    """Put the sections that were written so far into one page, and the figures that matter before them.

    Parameters
    ----------
    names : iterable of str
        Experiments in the order of the page; those without a section are named at its end.
    folder : Path
    """
    files = {name: folder / RESULTS / f"{name}.md" for name in names}
    sections = [file.read_text("utf-8") for file in files.values() if file.is_file()]
    linked = [re.sub(r"(!\[[^\]]*\]\()", rf"\1{RESULTS}/", section) for section in sections]
    unmeasured = [f"`{name}`" for name, file in files.items() if not file.is_file()]
    rest = [f"Not measured yet: {', '.join(unmeasured)}.\n"] if unmeasured else []
    first = [text for text in [write_headlines(folder / RESULTS)] if text]
    return write_atomic(folder / PAGE, "\n".join([_HEAD, *first, *linked, *rest]).encode())


def _section(experiment: Experiment, outcome: Outcome, bench: Bench) -> str:
    parts = [f"## {experiment.title}", experiment.about.strip()]
    parts += [seen_note(experiment.seen)] if experiment.seen else []
    parts += [table.to_markdown().strip() for table in outcome.tables]
    parts += [f"![{plot.title}]({_stem(experiment, plot.name)}.png)" for plot in outcome.plots]
    if outcome.text:
        parts.append(outcome.text.strip())
    sizes = " The smallest sizes only (`--quick`)." if bench.quick else ""
    seeds = f" Seeds: {', '.join(map(str, sorted(bench.seeds)))}." if bench.seeds else ""
    parts.append(
        f"<sub>`python -m experiments {experiment.name}`. Measured {', '.join(sorted(bench.dates))} on "
        f"{'; '.join(sorted(bench.machines))}.{seeds} {describe_versions()}.{sizes}</sub>"
    )
    return "\n\n".join(parts) + "\n"


def _stem(experiment: Experiment, suffix: str) -> str:
    return f"{experiment.name}_{suffix}" if suffix else experiment.name


def _png(plot: Plot) -> bytes:
    from matplotlib.figure import Figure

    figure = Figure(figsize=plot.size, layout="constrained")
    plot.draw(figure)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=_DPI, metadata={"Software": None})
    return stream.getvalue()
