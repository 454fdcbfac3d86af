"""``collalign batch``: many folders, one after the other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from collalign.cli.align_command import Given, align
from collalign.console.interruption import INCOMPLETE
from collalign.console.messages import add_to_summary, say, separate_summary, warn
from collalign.console.running import Run
from collalign.engine.run_options import RunOptions
from data_tools.errors import CollalignError

if TYPE_CHECKING:
    from collalign.stages.forecast import RunEstimate


def batch(
    file: Path,
    *,
    dry_run: bool = False,
    run: Run = RunOptions(),  # noqa: B008
) -> int:
    """Align many folders; a folder that fails does not stop the others.

    Parameters
    ----------
    file
        TOML file: [options] for all, and one [[jobs]] with folder, out and perhaps options for each folder.
    dry_run
        Only estimate the time of all stages, from a trial with the first shapes of each folder.
    """
    from collalign.batch import estimate_job, read_batch  # what computes, which help does without

    failed, jobs = False, []
    for job in read_batch(file):
        folder = ", ".join(map(str, job.folders))
        say(f"{folder} -> {job.out}")
        with separate_summary() as summary:
            jobs.append(summary)
            add_to_summary(folder=folder, out=str(job.out))
            try:
                if dry_run:
                    estimate = estimate_job(job, run)
                    _tell_estimate(estimate)
                    say(f"  {estimate}")
                else:
                    code = align(
                        [*job.folders],
                        out=job.out,
                        given=Given(
                            recursive=job.recursive,
                            parts=job.parts,
                            include=job.include,
                            kinds_by=job.kinds_by,
                        ),
                        options=job.options,
                        run=run,
                    )
                    add_to_summary(exit_code=code)
                    failed |= code != 0
            except BrokenPipeError:
                raise
            except (CollalignError, OSError) as error:
                warn(str(error))
                add_to_summary(
                    error=str(error),
                    exit_code=error.exit_code if isinstance(error, CollalignError) else 1,
                )
                failed = True
    add_to_summary(jobs=jobs)
    return INCOMPLETE if failed else 0


def _tell_estimate(estimate: RunEstimate) -> None:
    """Tell programs the numbers of an estimate; unknown ones are null."""
    stages = {
        stage: {"seconds": seconds, "tasks": estimate.tasks.get(stage)}
        for stage, seconds in estimate.stages_s.items()
    }
    add_to_summary(
        estimate=str(estimate),
        shapes=estimate.num_shapes,
        pairs=estimate.num_pairs,
        seconds=estimate.seconds,
        store_bytes=estimate.store_bytes,
        stages=stages,
    )
