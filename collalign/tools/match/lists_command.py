"""``collalign maps``: a map of all vertices for every pair of a list of deformable surfaces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from collalign.cli.interruption import INCOMPLETE, resumable
from collalign.cli.talk import say, tell, warn
from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session, progress_display
from collalign.engine.store.layout import STORE_FILE
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.products.shapes import Excluded
from collalign.tools.match.lists import MapOptions, match_surfaces, read_pairs
from data_tools.io.files import write_atomic
from data_tools.io.output_folder import OutputFolder
from data_tools.percent import percent


def maps(
    pairs: Path,
    *,
    out: Path,
    folder: Path | None = None,
    deformation: NonrigidOptions = NonrigidOptions(),  # noqa: B008
    surface: SurfaceOptions = SurfaceOptions(),  # noqa: B008
    run: Annotated[RunOptions, Parameter(name="*")] = RunOptions(),  # noqa: B008
) -> int:
    """Match all pairs of a list of deformable shapes and write one map each, as text and as npz.

    Parameters
    ----------
    pairs
        Text file: target and source file on each line.
    out
        Folder for the maps; an interrupted run goes on from the store in it.
    folder
        Where the shapes are; the folder of the list by default.
    """
    listed = read_pairs(pairs, folder)
    store = run.store or out / STORE_FILE
    run = replace(run, store=store)
    options = MapOptions(matching=deformation, surface=surface)
    inputs = [pairs, *(file for pair in listed for file in pair)]
    with resumable(store), OutputFolder.open(out, writer="maps", inputs=inputs) as output:
        with Session.open(options, run, progress_display(True)) as session:
            found = match_surfaces(session, listed)
        for (target, source), one in zip(listed, found, strict=True):
            if isinstance(one, Excluded):
                warn(f"Left out: {one.file}: {one.reason}")
                continue
            say(f"{target.name} <- {source.name}: confidence {percent(one.confidence)}")
            write_atomic(output.stage(f"{target.stem}__{source.stem}.npz"), one.npz)
            write_atomic(output.stage(f"{target.stem}__{source.stem}.txt"), one.text)
        output.publish(complete=True)
    num_failed = sum(isinstance(one, Excluded) for one in found)
    say(f"{len(found) - num_failed} of {len(found)} maps are in {out}")
    tell(maps=len(found) - num_failed, left_out=[vars(one) for one in found if isinstance(one, Excluded)])
    return INCOMPLETE if num_failed else 0
