"""A progress bar with rate and remaining time, fed by :func:`collalign.engine.jobs.run.run_jobs`."""

from __future__ import annotations

from typing import IO

from tqdm import tqdm

from collalign.engine.jobs.worker import Outcome


class ProgressBar:
    """Counts results, and shows rate, remaining time and failures on a terminal.

    Parameters
    ----------
    description : str
        What is counted, for instance ``"pairs"``; what stands in brackets after it is shown as well.
    total : int
        How many results are expected, those of earlier runs included.
    done : int
        How many earlier runs left; they do not count for the rate.
    file : optional
        Standard error by default.
    disable : bool
        Show nothing.
    """

    def __init__(
        self,
        description: str,
        total: int,
        *,
        done: int = 0,
        file: IO[str] | None = None,
        disable: bool = False,
    ) -> None:
        unit = description.partition(" (")[0].rstrip("s")
        self._bar = tqdm(desc=description, total=total, initial=done, file=file, unit=unit, disable=disable)
        self._num_failed = 0

    def __call__(self, outcome: Outcome) -> None:
        """Count one result."""
        if outcome.failure is not None:
            self._num_failed += 1
            self._bar.set_postfix(failed=self._num_failed, refresh=False)
        self.advance()

    def advance(self, num: int = 1) -> None:
        """Count so many results."""
        self._bar.update(num)

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *exception: object) -> None:
        self._bar.close()
