"""``python -m collalign.nonrigid PAIRS --out FOLDER``: one map for every pair of a list, resumable."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from collalign.nonrigid.batch import PairOutcome, match_pairs, read_pairs
from collalign.nonrigid.options import NonrigidOptions, SurfaceOptions
from data_tools.errors import CollalignError

#: Exit code of a run that left pairs out.
LEFT_OUT = 3

app = App(name="python -m collalign.nonrigid", help=__doc__)


@app.default
def batch(
    pairs: Path,
    *,
    out: Path,
    folder: Path | None = None,
    cache: Path | None = None,
    options: Annotated[NonrigidOptions, Parameter(name="*")] = NonrigidOptions(),  # noqa: B008
    surface: SurfaceOptions = SurfaceOptions(),  # noqa: B008
) -> int:
    """Match all pairs of a list and write one map each, as text and as npz.

    Parameters
    ----------
    pairs
        Text file: target and source file on each line.
    out
        Folder for the maps; maps that are there already are kept.
    folder
        Where the shapes are; the folder of the list by default.
    cache
        Folder for prepared shapes; inside the folder for the maps by default.
    """
    outcomes = match_pairs(
        read_pairs(pairs, folder),
        out,
        options=options,
        surface_options=surface,
        cache=cache,
        report=_print_outcome,
    )
    failed = sum(outcome.state == "failed" for outcome in outcomes)
    print(f"{len(outcomes) - failed} of {len(outcomes)} maps are in {out}")
    return LEFT_OUT if failed else 0


def _print_outcome(outcome: PairOutcome) -> None:
    detail = outcome.reason or (f"confidence {outcome.confidence:.2f}" if outcome.state == "matched" else "")
    print(f"{outcome.state}  {outcome.target.name}  {outcome.source.name}  {detail}".rstrip(), flush=True)


if __name__ == "__main__":
    try:
        sys.exit(app(result_action="return_value"))
    except CollalignError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
