"""What a person sees of the progress of a run: bars, and lines for logs. It imports nothing that takes long."""

from __future__ import annotations

import logging
import sys
import time
from contextvars import ContextVar
from typing import IO, TYPE_CHECKING

from tqdm import tqdm

if TYPE_CHECKING:
    from collalign.engine.session import ProgressFactory
    from collalign.engine.worker import Outcome

#: Says every stage as it begins, each minute of it and as it ends, for logs; ``record.numbers`` holds the numbers.
STAGES = logging.getLogger("collalign.stages")
#: Whether bars are drawn where somebody watches.
SHOW_BARS: ContextVar[bool] = ContextVar("show_bars", default=True)
_LINE_EVERY_S = 60.0


def is_watched() -> bool:
    """Return whether somebody watches bars, on a terminal or in a notebook."""
    return SHOW_BARS.get() and (sys.stderr.isatty() or "ipykernel" in sys.modules)


class ProgressBar:
    """Counts results, and shows rate, remaining time and failures where somebody watches; tells :data:`STAGES`.

    Parameters
    ----------
    description : str
        What is counted, for instance ``"pairs"``; what stands in brackets after it is shown as well.
    total : int
        How many results are expected, those of earlier runs included.
    done : int
        How many earlier runs left; they do not count for the rate.
    file : optional
        Standard error by default, where somebody watches it.
    """

    def __init__(
        self, description: str, total: int, *, done: int = 0, file: IO[str] | None = None
    ) -> None:
        unit = description.partition(" (")[0].rstrip("s")
        hidden = file is None and not is_watched()
        self._bar = tqdm(
            desc=description, total=total, initial=done, file=file, unit=unit, disable=hidden
        )
        self._description, self._total, self._num_done, self._num_failed = (
            description,
            total,
            done,
            0,
        )
        self._began_s = self._said_s = time.monotonic()
        self._say("begin")

    def __call__(self, outcome: Outcome) -> None:
        """Count one result."""
        if outcome.failure is not None:
            self._num_failed += 1
            self._bar.set_postfix(failed=self._num_failed, refresh=False)
        self.advance()

    def advance(self, num: int = 1) -> None:
        """Count so many results."""
        self._bar.update(num)
        self._num_done += num
        if time.monotonic() - self._said_s >= _LINE_EVERY_S:
            self._say("progress")

    def _say(self, event: str) -> None:
        self._said_s = time.monotonic()
        seconds = self._said_s - self._began_s
        failed = f", {self._num_failed} failed" if self._num_failed else ""
        took = "" if event == "begin" else f", {seconds:.1f} s"
        numbers = {
            "event": event,
            "stage": self._description,
            "done": self._num_done,
            "total": self._total,
            "failed": self._num_failed,
            "seconds": round(seconds, 3),
        }
        STAGES.info(
            "%s: %d of %d%s%s",
            self._description,
            self._num_done,
            self._total,
            failed,
            took,
            extra={"numbers": numbers},
        )

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *exception: object) -> None:
        self._bar.close()
        self._say("end")


def progress_display(progress: ProgressFactory | bool) -> ProgressFactory | None:
    """Return what shows the progress of a run: for True bars where somebody watches, lines where somebody listens."""
    if not isinstance(progress, bool):
        return progress
    return ProgressBar if progress and (is_watched() or STAGES.isEnabledFor(logging.INFO)) else None
