"""Aligns the collections of the goldens and says which results changed: ``python -m tests.goldens``.

Prints the hash of every file, and of those that changed how many values differ by more than the tolerance. Exits 1
where a hash changed. ``--write`` stores the results instead. Names take some collections only.
"""

import argparse
import tempfile
from pathlib import Path

from tests.goldens.inputs import GOLDENS
from tests.goldens.record import (
    STORED,
    aligned_record,
    changed_files,
    differences,
    load_record,
    store_record,
)

#: Lines that are printed of the values that differ in one collection.
MOST_LINES = 10


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "names", nargs="*", choices=[*GOLDENS, []], metavar="NAME", help=", ".join(GOLDENS)
    )
    parser.add_argument("--write", action="store_true", help="store the results")
    given = parser.parse_args()
    any_changed = False
    for name in given.names or GOLDENS:
        with tempfile.TemporaryDirectory() as folder:
            found = aligned_record(GOLDENS[name](), Path(folder))
        stored = load_record(name) if (STORED / f"{name}.json").exists() else None
        changed = [*found.hashes] if stored is None else changed_files(stored, found)
        any_changed |= bool(changed)
        for file, value in found.hashes.items():
            print(
                f"{name:10} {file:20} {value} {'changed' if file in changed else 'as stored'}",
                flush=True,
            )
        if changed and stored is not None:
            lines = differences(stored.values, found.values)
            print(
                f"{name:10} {len(lines)} values differ beyond the tolerance",
                *lines[:MOST_LINES],
                sep="\n  ",
            )
        if given.write:
            store_record(name, found)
    return int(any_changed and not given.write)


if __name__ == "__main__":
    raise SystemExit(main())
