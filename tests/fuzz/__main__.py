"""Damages files of every kind by the thousand: ``python -m tests.fuzz --shapes 10000 --stores 1000``.

``--readers N`` damages N files of every reader, ``--only .ply .stl`` of some, ``--landmarks N`` files of landmarks.
``--certificates N`` forges N certificates of every kind, and compares what they prove with brute force.
``--folders N`` forges N folders of a result, ``--overlaps N`` runs N of the ways in which output and input overlap.
"""

import argparse
import tempfile
import time
from functools import partial
from pathlib import Path

from data_tools.io.listing import READERS
from tests.fuzz import seeds, targets
from tests.fuzz.forgeries import attack_folders, honest_result
from tests.fuzz.harness import fuzz
from tests.fuzz.hostile import attack
from tests.fuzz.overlaps import attack_overlaps

FILES = ("shapes", "readers", "landmarks", "stores", "records", "certificate-files", "configs")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    for kind in (*FILES, "certificates", "folders", "overlaps"):
        parser.add_argument(f"--{kind}", type=int, default=0)
    parser.add_argument("--only", nargs="*", help="suffixes of the readers, all by default")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for the files that ended badly")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bad = [run(kind, options, Path(folder)) for kind in FILES]
        project = honest_result(Path(folder)) if options.folders or options.overlaps else Path(folder)
        attacks = {
            "certificates": attack,
            "folders": partial(attack_folders, project),
            "overlaps": partial(attack_overlaps, project.parent),
        }
        bad += [run_attack(kind, found, getattr(options, kind), options.seed) for kind, found in attacks.items()]
    return int(any(bad))


def run_attack(kind, attack, num, seed):
    """Forge so many and print what was said of them; returns how many ended badly."""
    if not num:
        return 0
    start_s = time.perf_counter()
    report = attack(num, seed=seed)
    print(f"{kind}: {report}; {time.perf_counter() - start_s:.0f} s", flush=True)
    for name, ending in report.bad.items():
        print(f"  {name}: {ending}", flush=True)
    return len(report.bad)


def run(kind, options, folder):
    """Fuzz one kind of file and print what happened; returns how many ended badly."""
    num = getattr(options, kind.replace("-", "_"))
    if not num:
        return 0
    if kind == "readers":
        return sum(run_reader(suffix, files, num, options) for suffix, files in by_suffix(folder).items())
    target, files = {
        "shapes": lambda: (targets.read_and_sample, seeds.shape_files(folder)),
        "landmarks": lambda: (targets.read_landmark_file, seeds.landmark_files()),
        "stores": lambda: (targets.read_store, {"a.store": seeds.store_file(folder)}),
        "records": lambda: (targets.read_record, seeds.records()),
        "certificate-files": lambda: (targets.read_certificate, {"a.npz": seeds.certificate_file(folder)}),
        "configs": lambda: (targets.read_config, {"a.toml": seeds.CONFIG.encode()}),
    }[kind]()
    return run_target(kind, target, files, num, options)


def by_suffix(folder):
    """Return the good shape files of each reader by its suffix."""
    files = seeds.shape_files(folder)
    return {suffix: {name: files[name] for name in files if name.endswith(suffix)} for suffix in READERS}


def run_reader(suffix, files, num, options):
    """Fuzz the files of one reader; returns how many ended badly."""
    if options.only and suffix not in options.only:
        return 0
    return run_target(f"reader {suffix}", targets.read_and_sample, files, num, options)


def run_target(kind, target, files, num, options):
    """Hand a target so many damaged files and print what happened; returns how many ended badly."""
    start_s = time.perf_counter()
    report = fuzz(target, files, num, seed=options.seed, num_jobs=options.jobs, keep=options.keep)
    print(f"{kind}: {report}; {time.perf_counter() - start_s:.0f} s", flush=True)
    for name, reason in report.bad.items():
        print(f"  {name}: {reason}", flush=True)
    return len(report.bad)


if __name__ == "__main__":
    raise SystemExit(main())
