"""Draws small faults of cosmic-ray, and runs the tests of the module that has one; in a clean clone.

Four commands count how many of 200 faults the tests notice::

    cosmic-ray init tests/mutants.toml mutants.sqlite
    python -m tests.mutants draw mutants.sqlite --num 200 --seed 1
    cosmic-ray exec tests/mutants.toml mutants.sqlite
    cr-report mutants.sqlite
"""

import argparse
import random
import re
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("collalign", "data_tools", "pairwise")
#: Operators that types share.
UNIONS = "core/ReplaceBinaryOperator_BitOr_%"


def draw(session, num, seed):
    """Keep so many faults of a session, every place in the code equally likely; the same seed keeps the same."""
    with closing(sqlite3.connect(session)) as base, base:
        rows = base.execute(
            "SELECT module_path, start_pos_row, start_pos_col, operator_name, occurrence, job_id"
            " FROM mutation_specs WHERE operator_name NOT LIKE ? ORDER BY 1, 2, 3, 4, 5",
            (UNIONS,),
        ).fetchall()
        places = {}
        for row in rows:
            places.setdefault(row[:3], []).append(row[-1])
        rng = random.Random(seed)
        chosen = rng.sample(sorted(places), min(num, len(places)))
        kept = [(rng.choice(places[place]),) for place in chosen]
        base.execute("CREATE TEMP TABLE kept (job_id)")
        base.executemany("INSERT INTO kept VALUES (?)", kept)
        for table in ("mutation_specs", "work_items"):
            base.execute(f"DELETE FROM {table} WHERE job_id NOT IN (SELECT job_id FROM kept)")
    return len(kept)


def files_for(module):
    """Return the test files of a module, given by its path.

    They are those of its folder that import it; where there are none, all files that import it, or its folder's.
    """
    folder, _, stem = module.removesuffix(".py").removesuffix("/__init__").rpartition("/")
    package = re.escape(folder.replace("/", "."))
    imports = re.compile(rf"{package}\.{stem}\b|from {package} import [^\n]*\b{stem}\b")
    home = ROOT / "tests" / folder
    while not home.is_dir():
        home = home.parent
    files = sorted((ROOT / "tests").rglob("test_*.py"))
    own = [file for file in files if file.parent == home]
    found = [file for file in files if imports.search(file.read_text("utf-8"))]
    tests = [file for file in found if file in own] or found or own
    return [file.relative_to(ROOT).as_posix() for file in tests]


def run_tests():
    """Run the tests of all modules that differ from the last commit, until one fails; return the exit code."""
    words = ["git", "diff", "--name-only", "--relative", "--", *PACKAGES]
    changed = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    tests = sorted({test for module in changed.split() for test in files_for(module)})
    words = [sys.executable, "-m", "pytest", "-x", "-m", "not data", *tests]
    return subprocess.run(words, cwd=ROOT, check=False).returncode


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("test")
    drawing = commands.add_parser("draw")
    drawing.add_argument("session", type=Path)
    drawing.add_argument("--num", type=int, default=200)
    drawing.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    if options.command == "test":
        return run_tests()
    print(draw(options.session, options.num, options.seed), "faults are left")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
