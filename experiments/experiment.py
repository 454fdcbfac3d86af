"""What an experiment is: measurements that a store keeps, and the tables and plots made of them.

An experiment is a module with a constant ``EXPERIMENT``. Its work is cut into cells, each a function of a module that
takes a :class:`Cell` and returns a record; :meth:`Bench.measure` computes those that the store lacks. Tables and
plots are made from the records alone, so a finished experiment is written again in no time, and an interrupted one
goes on.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from collalign.engine.job import Job, Wanted
from collalign.engine.progress import ProgressBar
from collalign.engine.records import Record
from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from collalign.engine.store import Store
from data_tools.errors import CollectionError, InputError
from experiments.provenance import describe_machine
from experiments.tables import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: SQLite file of finished measurements, from the folder that they are started in.
STORE = Path(".cache/experiments.sqlite")
#: Options of small alignments in quick runs.
QUICK_OPTIONS: dict[str, Any] = {
    "maps": "never",
    "sampling": {"num_points": 32, "num_dense_points": 200},
}
Draw: TypeAlias = "Callable[[Figure], None]"


@dataclass(frozen=True, kw_only=True)
class Cell:
    """What a measuring function gets.

    Attributes
    ----------
    data : Path
        Folder of the public collections.
    settings : dict
        Plain values; all that the result depends on, seeds included.
    """

    data: Path
    settings: dict[str, Any]


def measure_cell(function: Callable[[Cell], Record], cell: Cell, machine: str) -> Record:
    """Measure a cell; the record says when and where that was."""
    return {"value": function(cell), "date": datetime.date.today().isoformat(), "machine": machine}


def _whole(record: Record, name: str) -> Record:
    return record


@dataclass(frozen=True, kw_only=True)
class Plot:
    """A picture of an experiment.

    Attributes
    ----------
    draw : callable
        Draws on an empty matplotlib figure.
    name : str
        Suffix of its file name; empty for the only or main picture.
    title : str
        What it shows.
    size : tuple of float
        Inches.
    """

    draw: Draw
    title: str
    name: str = ""
    size: tuple[float, float] = (7.0, 4.0)


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What an experiment found.

    Attributes
    ----------
    tables : tuple of Table
    plots : tuple of Plot
    text : str
        Markdown below the tables: what falls short, what the figures do not say.
    """

    tables: tuple[Table, ...]
    plots: tuple[Plot, ...] = ()
    text: str = ""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """One command, ``python -m experiments NAME``.

    Attributes
    ----------
    name : str
    title : str
        Heading.
    about : str
        Markdown above the tables: what is measured and how, with the paper's section or figure.
    measure : callable
        Takes a :class:`Bench` and returns an :class:`Outcome`.
    collections : tuple of str
        Folders of the data that it cannot do without.
    seen : tuple of str
        Those of :data:`experiments.seen.SEEN` that its tables are about: the page says what was chosen on them.
    has_lines : bool
        Whether it measures some lines of its table by themselves, as ``Bench.only`` says.
    """

    name: str
    title: str
    about: str
    measure: Callable[[Bench], Outcome]
    collections: tuple[str, ...] = ()
    seen: tuple[str, ...] = ()
    has_lines: bool = False


@dataclass(kw_only=True)
class Bench:
    """Where an experiment runs, and what it has measured so far.

    Attributes
    ----------
    data : Path
        Folder of the public collections.
    store : Store
    num_workers : int
        Processes for cells that may run side by side.
    quick : bool
        The smallest sizes only, to see that everything works.
    quiet : bool
        No progress bars.
    results : Path, optional
        Folder of the tables that were written before, of experiments that compare with them.
    only : tuple of str
        Lines of the table that are measured; all if there are none.
    """

    data: Path
    store: Store
    num_workers: int = 1
    quick: bool = False
    quiet: bool = False
    results: Path | None = None
    only: tuple[str, ...] = ()
    seeds: set[int] = field(default_factory=set)
    dates: set[str] = field(default_factory=set)
    machines: set[str] = field(default_factory=set)
    num_reused: int = 0

    def wants(self, line: str) -> bool:
        """Return whether a line of the table is measured."""
        return not self.only or line in self.only

    def folder(self, name: str) -> Path:
        """Return the folder of a collection.

        Raises
        ------
        InputError
            If it is not there.
        """
        path = self.data / name
        if not path.is_dir():
            raise InputError(
                f"{path}: this collection is not here; name the folder of the collections with --data"
            )
        return path

    def measure(
        self,
        function: Callable[[Cell], Record],
        cells: Mapping[str, Mapping[str, Any]],
        *,
        version: str = "1",
        apart: bool = False,
    ) -> dict[str, Record]:
        """Return the records of all cells; those that the store lacks are computed and kept one by one.

        Parameters
        ----------
        function : callable
            Of a module, so that workers can import it.
        cells : mapping of label to settings
            Settings are plain values. The key of a record is the function, the version and the settings.
        version : str
            Raised whenever the function would give another answer for the same settings.
        apart : bool
            One cell after the other inside this process: for functions that start workers or measure wall time.

        Raises
        ------
        CollectionError
            If a cell failed; all others are kept.
        """
        name = f"{function.__module__}.{function.__qualname__}"
        job = Job(kind="measurements", version=f"{name} {version}", run=measure_cell, reader=_whole)
        machine = describe_machine()
        wanted = {
            label: Wanted(
                key=job.key(settings),
                label=label,
                arguments={
                    "function": function,
                    "cell": Cell(data=self.data, settings=dict(settings)),
                    "machine": machine,
                },
            )
            for label, settings in cells.items()
        }
        session = Session.around(
            self.store,
            None,
            RunOptions(jobs=1 if apart else self.num_workers),
            None if self.quiet else ProgressBar,
        )
        self.num_reused += session.num_reused("measurements", {one.key for one in wanted.values()})
        found = session.compute(job, wanted, time_limit_s=None, again=True)
        if found.failures:
            lines = "".join(f"\n  {label}: {reason}" for label, reason in found.failures.items())
            raise CollectionError(f"cells that failed:{lines}")
        return {label: self._remember(record) for label, record in found.items()}

    def _remember(self, record: Record) -> Record:
        value: Record = record["value"]
        self.dates.add(record["date"])
        self.machines.add(record["machine"])
        return value
