"""Kills a whole ``collalign align`` and its workers at random, asks it to end, and sees what is lost.

Run by hand: ``python -m tests.benchmarks.fault_test --kills 40 --signals 20``. After each ending the originals and
the files of others in the output folder must be as they were, no finished result may have left the store, and the
outputs must be those of one complete run, or lack the summary. At the end the results equal those of an undisturbed
run, and nothing temporary is left.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from collalign.engine.store import Store
from data_tools.datasets.synthetic import write_collection
from data_tools.io.output_folder import BOOKS
from tests.faults import FaultLog, run_with_kills
from tests.finished_runs import chairs

KINDS = ("shapes", "pairs")


class Watch:
    """What must never get lost: the originals, files of others, finished results, complete outputs."""

    def __init__(self, shapes, out):
        self._shapes, self._out = shapes, out
        self._originals = snapshot(shapes)
        self._done = dict.fromkeys(KINDS, frozenset())
        out.mkdir(exist_ok=True)
        (out / "meshes").mkdir(exist_ok=True)
        self._notes = (out / "notes.txt", out / "meshes" / "mine.ply")
        for note in self._notes:
            note.write_text("mine")

    def check(self):
        """Raise where anything is lost.

        Raises
        ------
        RuntimeError
            Saying what.
        """
        if snapshot(self._shapes) != self._originals:
            raise RuntimeError("the originals have changed")
        if any(not note.is_file() or note.read_text() != "mine" for note in self._notes):
            raise RuntimeError("a file of somebody else has changed")
        if (self._out / "store.sqlite").exists():
            with Store.open(self._out / "store.sqlite") as store:
                done = {kind: store.keys(kind) for kind in KINDS}
                for kind in KINDS:
                    if self._done[kind] - done[kind]:
                        raise RuntimeError(f"finished {kind} have left the store")
                    for key in done[kind]:
                        store.require(kind, key)
            self._done = done
        if (self._out / "alignment.json").exists():
            names = [
                shape["name"]
                for shape in json.loads((self._out / "alignment.json").read_text())["shapes"]
            ]
            missing = [
                name for name in names if not (self._out / "meshes" / f"{name}.ply").is_file()
            ]
            if missing:
                raise RuntimeError(f"there is a summary, but no mesh of {missing}")

    def check_end(self):
        """Raise where something temporary is left in the output folder."""
        self.check()
        left = sorted(path.name for path in (self._out / BOOKS).iterdir())
        if set(left) - {"lock"} != {"manifest.json"}:
            raise RuntimeError(f"left behind: {left}")


def snapshot(folder):
    """Return the content of every file of a folder."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def outputs(out):
    """Return the outputs that may not differ between runs."""
    paths = [
        out / "alignment.json",
        out / "pairs.csv",
        *sorted((out / "meshes").glob("chair*.ply")),
    ]
    return {path.name: path.read_bytes() for path in paths}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=40)
    parser.add_argument("--signals", type=int, default=20)
    parser.add_argument("--shapes", type=int, default=24)
    parser.add_argument("--points", type=int, default=40)
    parser.add_argument(
        "--delay", type=float, nargs=2, default=(1.0, 8.0), help="seconds between disturbances"
    )
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        compare(Path(folder), options)


def compare(folder, options):
    """Run undisturbed once, then disturbed until there were enough kills and signals, and compare.

    Raises
    ------
    RuntimeError
        If anything was lost or a result differs.
    """
    rng = np.random.default_rng(options.seed)
    shapes = folder / "shapes"
    write_collection(shapes, chairs(options.shapes))
    start_s = time.perf_counter()
    run_with_kills(command(shapes, folder / "expected", options), 0, rng, delay_s=(1.0, 1.0))
    expected = outputs(folder / "expected")
    print(f"undisturbed: {time.perf_counter() - start_s:.1f} s")
    total, rounds, start_s = FaultLog(), 0, time.perf_counter()
    while total.kills < options.kills or total.signals < options.signals:
        out = folder / f"out{rounds}"
        watch = Watch(shapes, out)
        log = run_with_kills(
            command(shapes, out, options),
            options.kills - total.kills,
            rng,
            delay_s=tuple(options.delay),
            resume_codes=(3,),
            num_signals=options.signals - total.signals,
            check=watch.check,
        )
        watch.check_end()
        if outputs(out) != expected:
            raise RuntimeError(
                f"the results of round {rounds} differ from those of an undisturbed run"
            )
        total.parents, total.workers = total.parents + log.parents, total.workers + log.workers
        total.signals += log.signals
        rounds += 1
        print(
            f"round {rounds}: {log.parents} parents and {log.workers} workers killed, {log.signals} signals",
            flush=True,
        )
    print(
        f"{total.kills} kills ({total.parents} parents, {total.workers} workers) and {total.signals} signals in "
        f"{rounds} runs, {time.perf_counter() - start_s:.0f} s: nothing lost, all results identical"
    )
    return total


def command(shapes, out, options):
    """Return the command that aligns the shapes, with its store in the output folder."""
    words = [
        sys.executable,
        "-m",
        "collalign",
        "align",
        str(shapes),
        "--out",
        str(out),
        "--jobs",
        "2",
    ]
    return [
        *words,
        "--pairs",
        "all",
        "--sampling.num-points",
        str(options.points),
        "--sampling.num-dense-points",
        "0",
    ]


if __name__ == "__main__":
    main()
