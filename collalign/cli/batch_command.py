"""``collalign batch``: many folders, one after the other."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from collalign.batch import estimate_job, read_batch
from collalign.cli.align_command import align
from collalign.cli.interruption import INCOMPLETE
from collalign.engine.run_options import RunOptions
from data_tools.errors import CollalignError


def batch(
    file: Path,
    *,
    dry_run: bool = False,
    run: Annotated[RunOptions, Parameter(name="*")] = RunOptions(),  # noqa: B008
) -> int:
    """Align many folders; a folder that fails does not stop the others.

    Parameters
    ----------
    file
        TOML file: [options] for all, and one [[jobs]] with folder, out and perhaps options for each folder.
    dry_run
        Only estimate time, disk space and memory of all stages, from a trial with the first shapes of each folder.
    """
    failed = False
    for job in read_batch(file):
        print(f"{job.folder} -> {job.out}")
        try:
            if dry_run:
                print(f"  {estimate_job(job, run)}")
            else:
                failed |= align(job.folder, out=job.out, options=job.options, run=run) != 0
        except BrokenPipeError:
            raise
        except (CollalignError, OSError) as error:
            print(f"collalign: {error}", file=sys.stderr)
            failed = True
    return INCOMPLETE if failed else 0
