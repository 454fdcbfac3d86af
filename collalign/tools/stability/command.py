"""``collalign stability``: what stays when the alignment is repeated otherwise."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from collalign.console.interruption import resumable
from collalign.console.messages import say, say_files
from collalign.engine.run_options import RunOptions
from collalign.output.loading import load
from collalign.tools.stability.files import FILES, WRITER, stability_summary, write_stability
from collalign.tools.stability.run import StabilityOptions, check_stability
from data_tools.io.output_folder import OutputFolder
from data_tools.io.source import inputs_of


def stability(
    result: Path,
    *,
    options: Annotated[StabilityOptions, Parameter(name="*")] = StabilityOptions(),  # noqa: B008
    run: Annotated[RunOptions, Parameter(name="*")] = RunOptions(),  # noqa: B008
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
