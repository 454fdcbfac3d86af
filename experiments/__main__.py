"""``python -m experiments NAME...``: measure, write tables and plots, and renew RESULTS.md."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from cyclopts import App

from collalign.engine.store import Store
from data_tools.errors import CollalignError, InputError
from data_tools.threads import one_blas_thread
from experiments import NAMES, load_experiment
from experiments.calibration import calibrate
from experiments.calibration.sensitivity import ROOMS, sensitivity
from experiments.experiment import STORE, Bench
from experiments.write import RESULTS, write_experiment, write_page

app = App(name="python -m experiments", help=__doc__, result_action="return_value")


@app.command(name="calibrate")
@one_blas_thread()
def run_calibration(
    name: str, *collections: str, data: Path = Path("../shared/data"), quick: bool = False
) -> int:
    """Measure again what the tuned constants of an estimator stand for, beside their values in the code.

    Parameters
    ----------
    name
        The estimator, see experiments/calibration.
    collections
        Which collections to use; the estimator's own if none is named.
    data
        Folder of the public collections.
    quick
        The smallest sizes only, to see that everything works.
    """
    print(calibrate(name, data, collections, quick=quick).to_markdown())
    return 0


@app.command(name="sensitivity")
@one_blas_thread()
def run_sensitivity(
    *places: str,
    data: Path = Path("../shared/data"),
    store: Path = STORE,
    jobs: int = 1,
    quick: bool = False,
) -> int:
    """Measure by how much a small scoreboard moves when each tuned number is halved and doubled.

    Parameters
    ----------
    places
        Rooms, modules or constants by their dotted names; all that decides poses and confidences if none is named.
    data
        Folder of the public collections.
    store
        SQLite file of finished measurements, so that an interrupted one goes on.
    jobs
        Processes that measure side by side.
    quick
        One generated family only, to see that everything works.
    """
    store.parent.mkdir(parents=True, exist_ok=True)
    with Store.open(store) as opened:
        bench = Bench(data=data, store=opened, num_workers=jobs, quick=quick)
        print(sensitivity(bench, places or ROOMS).to_markdown())
    return 0


@app.default
@one_blas_thread()
def run(
    *names: str,
    data: Path = Path("../shared/data"),
    out: Path = Path("."),
    store: Path | None = None,
    jobs: int = -1,
    quick: bool = False,
    quiet: bool = False,
    only: tuple[str, ...] = (),
) -> int:
    """Run experiments.

    Parameters
    ----------
    names
        Which ones, or `all`; without a name they are listed.
    data
        Folder of the public collections, each in the layout that its publisher gave it.
    out
        Gets RESULTS.md and the folder results.
    store
        SQLite file of finished measurements, so that an interrupted experiment goes on; OUT/.cache/experiments.sqlite
        if not given.
    jobs
        Processes for measurements that may run side by side; -1 is one per core.
    quick
        The smallest sizes only, to see that everything works.
    quiet
        No progress bars.
    only
        A line of the table of `speed` that is measured; may be given several times. The page names the others.
    """
    if not names:
        for name in NAMES:
            print(f"{name:20s} {load_experiment(name).title}")
        return 0
    chosen = NAMES if names == ("all",) else names
    experiments = [load_experiment(name) for name in chosen]
    if whole := [one.name for one in experiments if only and not one.has_lines]:
        raise InputError(f"{whole[0]}: --only does not apply, its table is measured as a whole")
    path = store or out / STORE
    path.parent.mkdir(parents=True, exist_ok=True)
    num_workers = max(1, os.cpu_count() or 1) if jobs == -1 else jobs
    with Store.open(path) as opened:
        for experiment in experiments:
            missing = [name for name in experiment.collections if not (data / name).is_dir()]
            if missing and names != ("all",):
                raise InputError(f"{experiment.name}: {data / missing[0]} is not there; see --data")
            if missing:
                print(f"{experiment.name}: left out, {data / missing[0]} is not there")
                continue
            bench = Bench(
                data=data,
                store=opened,
                num_workers=num_workers,
                quick=quick,
                quiet=quiet,
                results=out / RESULTS,
                only=only,
            )
            outcome = experiment.measure(bench)
            for file in write_experiment(experiment, outcome, bench, out):
                print(file)
    print(write_page(NAMES, out))
    return 0


def main() -> int:
    """Run the command line; errors of the input become one line and exit code 2."""
    try:
        return int(app() or 0)
    except CollalignError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
