"""Damages files of every kind by the thousand: ``python -m tests.fuzz --shapes 10000 --stores 1000``."""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from tests.fuzz import seeds, targets
from tests.fuzz.harness import fuzz

KINDS = ("shapes", "stores", "records", "certificates", "configs")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    for kind in KINDS:
        parser.add_argument(f"--{kind}", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for the files that ended badly")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bad = [run(kind, options, Path(folder)) for kind in KINDS]
    return int(any(bad))


def run(kind: str, options: argparse.Namespace, folder: Path) -> int:
    """Fuzz one kind of file and print what happened; returns how many ended badly."""
    num = getattr(options, kind)
    if not num:
        return 0
    target, files = {
        "shapes": lambda: (targets.read_and_sample, seeds.shape_files(folder)),
        "stores": lambda: (targets.read_store, {"a.store": seeds.store_file(folder)}),
        "records": lambda: (targets.read_record, seeds.records()),
        "certificates": lambda: (targets.read_certificate, {"a.npz": seeds.certificate_file(folder)}),
        "configs": lambda: (targets.read_config, {"a.toml": seeds.CONFIG.encode()}),
    }[kind]()
    start_s = time.perf_counter()
    report = fuzz(target, files, num, seed=options.seed, num_jobs=options.jobs, keep=options.keep)
    print(f"{kind}: {report}; {time.perf_counter() - start_s:.0f} s", flush=True)
    for name, reason in report.bad.items():
        print(f"  {name}: {reason}", flush=True)
    return len(report.bad)


if __name__ == "__main__":
    raise SystemExit(main())
