"""Faults are drawn by the seed alone, and every module has tests."""

import shutil
import sqlite3
from contextlib import closing

import pytest

from tests.mutants import PACKAGES, ROOT, UNIONS, draw, files_for

COLUMNS = "module_path, operator_name, occurrence, start_pos_row, start_pos_col, job_id"


@pytest.fixture
def session(tmp_path):
    """Fifty places in the layout of cosmic-ray, of three faults each, and one union of types."""
    path = tmp_path / "session.sqlite"
    with closing(sqlite3.connect(path)) as base, base:
        base.execute(f"CREATE TABLE mutation_specs ({COLUMNS})")
        base.execute("CREATE TABLE work_items (job_id)")
        rows = [("a.py", f"op{i % 3}", 0, i // 3, 0, f"job {i}") for i in range(150)]
        rows.append(("a.py", UNIONS.replace("%", "Add"), 0, 99, 0, "union"))
        base.executemany("INSERT INTO mutation_specs VALUES (?, ?, ?, ?, ?, ?)", rows)
        base.executemany("INSERT INTO work_items VALUES (?)", [row[-1:] for row in rows])
    return path


def kept(session, num, seed):
    copy = session.with_suffix(f".{num}-{seed}")
    shutil.copy(session, copy)
    draw(copy, num, seed)
    with closing(sqlite3.connect(copy)) as base:
        items = [job for (job,) in base.execute("SELECT job_id FROM work_items")]
        rows = base.execute("SELECT job_id, start_pos_row FROM mutation_specs").fetchall()
    assert sorted(items) == sorted(job for job, _ in rows)
    return rows


def test_one_fault_a_place_is_drawn_by_the_seed(session):
    drawn = kept(session, 20, 1)
    assert len({row for _, row in drawn}) == len(drawn) == 20
    assert drawn == kept(session, 20, 1) != kept(session, 20, 2)
    assert len(kept(session, 1000, 0)) == 50, "types are no places"


def test_every_module_has_tests_and_its_own_come_first():
    assert files_for("pairwise/rotation_sets.py")[-1].startswith("tests/pairwise/")
    assert "tests/data_tools/surface/test_hidden.py" in files_for("data_tools/surface/hidden.py")
    for package in PACKAGES:
        for file in (ROOT / package).rglob("*.py"):
            assert files_for(file.relative_to(ROOT).as_posix())
