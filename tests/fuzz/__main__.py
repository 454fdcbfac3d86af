"""Damages files of every kind by the thousand: ``python -m tests.fuzz --shapes 10000 --stores 1000``.

``--certificates N`` forges N certificates of every kind, and compares what they prove with brute force.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from tests.fuzz import seeds, targets
from tests.fuzz.harness import fuzz
from tests.fuzz.hostile import attack

FILES = ("shapes", "stores", "records", "certificate-files", "configs")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    for kind in (*FILES, "certificates"):
        parser.add_argument(f"--{kind}", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for the files that ended badly")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bad = [run(kind, options, Path(folder)) for kind in FILES]
    return int(any(bad) or bool(forge_certificates(options.certificates, options.seed)))


def forge_certificates(num: int, seed: int) -> int:
    """Forge certificates and print what the verifier said; returns how many ended badly."""
    if not num:
        return 0
    start_s = time.perf_counter()
    report = attack(num, seed=seed)
    print(f"forged: {report}; {time.perf_counter() - start_s:.0f} s", flush=True)
    for name, ending in report.bad.items():
        print(f"  {name}: {ending}", flush=True)
    return len(report.bad)


def run(kind: str, options: argparse.Namespace, folder: Path) -> int:
    """Fuzz one kind of file and print what happened; returns how many ended badly."""
    num = getattr(options, kind.replace("-", "_"))
    if not num:
        return 0
    target, files = {
        "shapes": lambda: (targets.read_and_sample, seeds.shape_files(folder)),
        "stores": lambda: (targets.read_store, {"a.store": seeds.store_file(folder)}),
        "records": lambda: (targets.read_record, seeds.records()),
        "certificate-files": lambda: (targets.read_certificate, {"a.npz": seeds.certificate_file(folder)}),
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
