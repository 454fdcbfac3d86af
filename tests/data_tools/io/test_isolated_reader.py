from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from data_tools.errors import InputError
from data_tools.io import isolated_reader
from data_tools.io.isolated_reader import IsolatedReader
from data_tools.io.shapes import read_shape
from data_tools.options import CleaningOptions

TETRAHEDRON = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


@pytest.fixture
def mesh_file(tmp_path: Path) -> Path:
    path = tmp_path / "tooth.off"
    path.write_text(TETRAHEDRON)
    return path


@pytest.fixture(scope="module")
def reader() -> Iterator[IsolatedReader]:
    with IsolatedReader(time_limit_s=20.0) as reader:
        yield reader


@pytest.fixture(scope="module")
def wild_reader() -> Iterator[IsolatedReader]:
    """A reader that does what a file's name says: crash, hang, fill the memory, print, or answer nonsense."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(isolated_reader, "PROCESS_MODULE", "tests.wild_reader_process")
        with IsolatedReader(time_limit_s=1.0, memory_limit_bytes=2**29) as reader:
            yield reader


def test_a_shape_is_the_same_as_when_read_here(reader: IsolatedReader, mesh_file: Path) -> None:
    for cleaning in (None, CleaningOptions(merge_vertices=False)):
        there = reader.read(mesh_file, cleaning, name="molar")
        here = read_shape(mesh_file, cleaning, name="molar")
        assert there.vertices.tobytes() == here.vertices.tobytes()
        assert there.faces.tobytes() == here.faces.tobytes()
        assert (there.name, there.notes, there.file) == (here.name, here.notes, here.file)
        assert not there.vertices.flags.writeable
    assert reader.read(str(mesh_file)).name == "tooth"


def test_errors_are_those_of_the_reader(reader: IsolatedReader, tmp_path: Path, mesh_file: Path) -> None:
    broken = tmp_path / "broken.off"
    broken.write_text(TETRAHEDRON.replace("3 1 2 3", "3 1 2 9"))
    for path in (broken, tmp_path / "missing.ply", tmp_path):
        with pytest.raises(InputError) as there:
            reader.read(path)
        with pytest.raises(InputError) as here:
            read_shape(path)
        assert str(there.value) == str(here.value)
    assert len(reader.read(mesh_file).vertices) == 4


@pytest.mark.parametrize(
    ("behaviour", "reason"),
    [
        ("segfault", "SIGSEGV"),
        ("exit", "exit code 3"),
        ("hang", "longer than 1 s"),
        ("fill", "does not fit in memory"),
        ("negative", "nonsense"),
        ("huge", "nonsense"),
        ("list", "nonsense"),
        ("index", "faces"),
        ("raise", "RecursionError"),
    ],
)
def test_a_wild_reader_costs_only_its_file(
    wild_reader: IsolatedReader, tmp_path: Path, behaviour: str, reason: str
) -> None:
    path = tmp_path / f"{behaviour}.off"
    path.write_text(TETRAHEDRON)
    with pytest.raises(InputError, match=reason) as error:
        wild_reader.read(path)
    assert behaviour in str(error.value)


def test_what_a_library_prints_does_not_disturb(wild_reader: IsolatedReader, tmp_path: Path) -> None:
    path = tmp_path / "print.off"
    path.write_text(TETRAHEDRON)
    assert np.array_equal(wild_reader.read(path).vertices, read_shape(path).vertices)


def test_a_process_that_does_not_start_is_said(monkeypatch: pytest.MonkeyPatch, mesh_file: Path) -> None:
    monkeypatch.setattr(isolated_reader, "PROCESS_MODULE", "tests.no_such_module")
    with IsolatedReader() as reader, pytest.raises(InputError, match="does not start"):
        reader.read(mesh_file)


def test_closing_twice_is_fine(mesh_file: Path) -> None:
    reader = IsolatedReader()
    reader.close()
    assert len(reader.read(mesh_file).faces) == 4
    reader.close()
    reader.close()
