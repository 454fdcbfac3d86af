"""Damages files of every kind by the thousand: ``python -m tests.fuzz shapes=10000 stores=1000 .ply=500``.

Kinds are those of :func:`tests.fuzz.targets.kinds`, among them every reader's suffix. ``certificates=N`` forges N
certificates of every kind, and compares what they prove with brute force; ``folders=N`` forges N folders of a result.
``hostile`` reads all files of :mod:`tests.fuzz.hostile_files`, each with 2 GiB of memory and 30 s; ``hostile=N``
reads so many of them.
"""

import argparse
import tempfile
import time
from pathlib import Path

from tests.fuzz.confined import confined_endings
from tests.fuzz.forgeries import folder_endings, honest_result
from tests.fuzz.harness import Report, fuzz
from tests.fuzz.hostile import certificate_endings
from tests.fuzz.hostile_files import cases
from tests.fuzz.targets import kinds


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="+", metavar="KIND[=NUMBER]")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for the files that ended badly")
    options = parser.parse_args()
    attacks = {
        "certificates": lambda place, **how: certificate_endings(**how),
        "folders": lambda place, **how: folder_endings(honest_result(place), **how),
        "hostile": lambda place, num, seed: confined_endings(cases(), num=num),
    }
    bad = 0
    for kind, _, num in (word.partition("=") for word in options.kinds):
        with tempfile.TemporaryDirectory() as place:
            start_s, how = time.perf_counter(), {"num": int(num or 0), "seed": options.seed}
            if kind in attacks:
                endings = attacks[kind](Path(place), **how)
            else:
                numbers, how = {kind: int(num)}, {"num_jobs": options.jobs, "keep": options.keep}
                endings = fuzz(kinds(Path(place)), numbers, seed=options.seed, **how)
            report = Report.of(endings)
        print(f"{kind}: {report}; {time.perf_counter() - start_s:.0f} s", flush=True)
        for name, ending in report.bad.items():
            print(f"  {name}: {ending}", flush=True)
        bad += len(report.bad)
    return int(bad > 0)


if __name__ == "__main__":
    raise SystemExit(main())
