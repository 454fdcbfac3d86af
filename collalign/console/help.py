"""The help of a command with many options, one screen first, everything with ``--help-all``; what commands share."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.help import DefaultFormatter, HelpEntry, HelpPanel

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions

#: An option that is given or not.
Flag = Annotated[bool, Parameter(negative=())]
#: Shapes that a command leaves out.
Excluded = Annotated[
    tuple[str, ...],
    Parameter(consume_multiple=True, negative=(), help="Names of shapes that are left out."),
]
#: Tables that a command takes as shapes.
Included = Annotated[
    tuple[str, ...],
    Parameter(
        consume_multiple=True,
        negative=(),
        help="Patterns of names ('*.csv') of tables that are shapes although they lie beside meshes.",
    ),
]

#: The flag that asks for all options.
HELP_ALL = "--help-all"
#: What most people need of a command with many options.
_BASIC = frozenset(
    f"--{name}"
    for name in (
        *(
            "certify",
            "check",
            "classify",
            "clusters",
            "budget-s",
            "corrections",
            "curves",
            "shapes",
            "dry-run",
            "file",
        ),
        *(
            "folder",
            "format",
            "group",
            "jobs",
            "labels",
            "kinds-by",
            "landmarks",
            "leave-one-out",
            "nonrigid",
            "num-shapes",
        ),
        *(
            "num-points",
            "num-seeds",
            "num-subsets",
            "out",
            "partial",
            "parts",
            "patches",
            "recursive",
            "result",
        ),
        *("sampling.num-points", "scaling", "source", "symmetry", "target", "to", "verify"),
    )
)
#: Title of each further group, and how the names of its options begin.
_GROUPS = {
    "Sampling": ("--sampling.", "--embedding.", "--cleaning."),
    "Matching": ("--pairs", "--refine", "--certify", "--matching."),
    "Non-rigid matching": ("--deformation.", "--surface."),
    "Running": (
        "--jobs",
        "--store",
        "--scheduler",
        "--shape-time",
        "--pair-time",
        "--memory",
        "--strict",
        "--seed",
    ),
}
_OTHERS = "Advanced"
#: Commands with at most so many options show them all.
_MAX_TOGETHER = 12


class GroupedHelp:
    """Draws the panels of a command's help, in the place that cyclopts gives to formatters.

    Parameters
    ----------
    everything : bool
        All groups; otherwise the basic one of a command with many options.
    """

    def __init__(self, *, everything: bool) -> None:
        self._everything = everything
        self._draw = DefaultFormatter()

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Draw one panel of cyclopts, as several where it holds many options."""
        if panel.format != "parameter" or len(panel.entries) <= _MAX_TOGETHER:
            self._draw(console, options, panel)
            return
        groups = grouped(panel.entries)
        for title, entries in groups.items():
            if self._everything or title == "Basic":
                self._draw(console, options, panel.copy(title=title, entries=entries))
        if not self._everything:
            num_more = len(panel.entries) - len(groups["Basic"])
            console.print(
                f"{HELP_ALL} shows {num_more} more options: {', '.join(list(groups)[1:]).lower()}."
            )


def grouped(entries: Iterable[HelpEntry]) -> dict[str, list[HelpEntry]]:
    """Return the options by group, in the order of the groups; none is left out or listed twice."""
    groups: dict[str, list[HelpEntry]] = {title: [] for title in ("Basic", *_GROUPS, _OTHERS)}
    for entry in entries:
        groups[_title(entry)].append(entry)
    return {title: members for title, members in groups.items() if members}


def _title(entry: HelpEntry) -> str:
    if _BASIC.intersection(entry.positive_names):
        return "Basic"
    for title, beginnings in _GROUPS.items():
        if any(name.startswith(beginnings) for name in entry.positive_names):
            return title
    return _OTHERS
