"""Writes what an experiment found: CSV, Markdown and pictures, and the page that links to all experiments."""

from __future__ import annotations

import io
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

The commands `python -m experiments NAME` measure all figures and write this page and the folder `results`. Nobody
edits them by hand. Each experiment has a page, linked below. It says how and when it was measured, on which machine,
and where goals were missed. `results/NAME.csv` has its tables at full precision.

Some collections are not independent, because constants of the toolkit were chosen on them: the teeth, SCAPE, and
the classes of SHREC07 and, less so, those of CAPOD. The pages concerned repeat this. Mouse skulls and generated
families are independent but where a page says otherwise.
"""


def write_experiment(
    experiment: Experiment, outcome: Outcome, bench: Bench, folder: Path
) -> list[Path]:
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
        written.append(
            write_atomic(results / f"{_stem(experiment, table.name)}.csv", table.to_csv().encode())
        )
    for plot in outcome.plots:
        written.append(write_atomic(results / f"{_stem(experiment, plot.name)}.png", _png(plot)))
    written.append(
        write_atomic(
            results / f"{experiment.name}.md", _section(experiment, outcome, bench).encode()
        )
    )
    return written


def write_page(names: Iterable[str], folder: Path) -> Path:
    """Write the page with the figures that matter and a link to each experiment that was measured.

    Parameters
    ----------
    names : iterable of str
        Experiments in the order of the page; those that were not measured are named at its end.
    folder : Path
    """
    files = {name: folder / RESULTS / f"{name}.md" for name in names}
    links = [_link(name, file.read_text("utf-8")) for name, file in files.items() if file.is_file()]
    table = "\n".join(
        ["## All experiments", "", "| experiment | command |", "| --- | --- |", *links, ""]
    )
    unmeasured = [f"`{name}`" for name, file in files.items() if not file.is_file()]
    rest = [f"Not measured yet: {', '.join(unmeasured)}.\n"] if unmeasured else []
    first = [text for text in [write_headlines(folder / RESULTS)] if text]
    return write_atomic(folder / PAGE, "\n".join([_HEAD, *first, table, *rest]).encode())


def _link(name: str, section: str) -> str:
    """Return the row of an experiment, whose title is the first line of its section."""
    title = section.partition("\n")[0].removeprefix("## ")
    return f"| [{title}]({RESULTS}/{name}.md) | `python -m experiments {name}` |"


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
