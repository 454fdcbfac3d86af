"""Kills a whole ``collalign align`` and its workers at random, and compares the result with an undisturbed run.

Run by hand: ``python -m tests.benchmarks.fault_test --kills 100 --shapes 24``.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from collalign.engine.store.store import Store
from data_tools.datasets.synthetic import deformed_family, planted_collection, write_collection
from data_tools.datasets.synthetic_shapes import chair
from tests.faults import FaultLog, run_with_kills


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--shapes", type=int, default=24)
    parser.add_argument("--points", type=int, default=40)
    parser.add_argument("--delay", type=float, nargs=2, default=(1.0, 8.0), help="seconds between kills")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    with tempfile.TemporaryDirectory() as folder:
        compare(Path(folder), options, rng)


def compare(folder: Path, options: argparse.Namespace, rng: np.random.Generator) -> None:
    family = deformed_family(chair(rng, resolution=1), options.shapes, rng, rms=0.02)
    write_collection(folder / "shapes", planted_collection(family, rng))
    start_s = time.perf_counter()
    expected = undisturbed(folder, options)
    print(f"undisturbed: {time.perf_counter() - start_s:.1f} s")
    total, rounds, identical, start_s = FaultLog(), 0, 0, time.perf_counter()
    while total.kills < options.kills:
        out, store = folder / f"out{rounds}", folder / f"killed{rounds}.store"
        left = options.kills - total.kills
        words, delay_s = command(folder, out, store, options), tuple(options.delay)
        log = run_with_kills(words, left, rng, delay_s=delay_s, resume_codes=(3,))
        total.parents += log.parents
        total.workers += log.workers
        rounds += 1
        identical += (out / "alignment.json").read_bytes() == expected
        print(
            f"round {rounds}: {log.parents} parents and {log.workers} workers killed; exit codes "
            f"{log.endings}; {outcome(store)}",
            flush=True,
        )
    print(
        f"{total.kills} kills ({total.parents} parents, {total.workers} workers) in {rounds} runs, "
        f"{time.perf_counter() - start_s:.0f} s: {identical} of {rounds} results identical"
    )


def undisturbed(folder: Path, options: argparse.Namespace) -> bytes:
    out, store = folder / "expected", folder / "undisturbed.store"
    run_with_kills(command(folder, out, store, options), 0, np.random.default_rng(0), delay_s=(1.0, 1.0))
    return (out / "alignment.json").read_bytes()


def command(folder: Path, out: Path, store: Path, options: argparse.Namespace) -> list[str]:
    words = [sys.executable, "-m", "collalign", "align", str(folder / "shapes"), "--out", str(out)]
    words += ["--store", str(store), "--jobs", "2", "--pairs", "all"]
    return [*words, "--sampling.num-points", str(options.points), "--sampling.num-dense-points", "0"]


def outcome(store: Path) -> str:
    with Store.open(store, read_only=True) as opened:
        counts = opened.status()["pairs"]
    return f"{counts.done} of {counts.planned} pairs done, {counts.failed} failed"


if __name__ == "__main__":
    main()
