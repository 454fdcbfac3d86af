"""Which files of a folder are shapes: tables beside meshes are not, unless somebody names them."""

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import blob
from data_tools.io.listing import read_folder, shapes_at
from data_tools.io.objects import list_shapes
from data_tools.io.shapes import write_mesh
from data_tools.surface.shape import Shape

TABLE = "x,y,z\n0,0,0\n1,0,0\n0,1,0\n0,0,1\n"
ROWS = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"


@pytest.fixture
def folder(tmp_path):
    """Two meshes, tables called like them, and others."""
    for name in ("s0", "s1"):
        write_mesh(tmp_path / f"{name}.ply", blob(np.random.default_rng(0), num_vertices=50))
    for name in ("s0.csv", "S1_landmarks.csv", "measured.txt"):
        (tmp_path / name).write_text(TABLE)
    for name in ("s0.xyz", "s1-points.pts", "s10.xyz", "other.asc"):
        (tmp_path / name).write_text(ROWS)
    return tmp_path


def test_tables_beside_meshes_are_no_shapes_and_change_no_name(folder):
    listing = read_folder(folder)
    assert listing.names == ("other", "s0", "s1", "s10")
    assert {*listing.skipped_names} == {
        *("measured.txt", "s0.csv", "s0.xyz", "s1-points.pts", "S1_landmarks.csv")
    }


def test_whoever_names_a_table_gets_it(folder):
    included = read_folder(folder, include=["*.csv"])
    assert {"s0.csv", "s0", "S1_landmarks.csv"} <= {*included.names}
    assert "measured.txt" in included.skipped_names
    assert list_shapes(folder, include=["s0.xyz"]).names[1:3] == ("s0", "s0.xyz")
    assert list_shapes(folder / "*.csv").names == ("s0", "S1_landmarks")
    assert len(list_shapes([*folder.glob("s0.*")]).names) == 3
    (folder / "list").write_text(".\nmeasured.txt\n")
    assert "measured.txt" in [path.name for path in shapes_at(f"@{folder / 'list'}").files]


def test_tables_alone_and_beside_clouds_are_clouds(tmp_path):
    for name in ("a.csv", "b.txt", "c.xyz"):
        (tmp_path / name).write_text(TABLE)
    assert read_folder(tmp_path).names == ("a", "b", "c")
    write_mesh(tmp_path / "d.ply", Shape.from_arrays(np.random.default_rng(0).random((9, 3))))
    (tmp_path / "e.pcd").write_text("")
    assert read_folder(tmp_path).names == ("a", "b", "c", "d", "e")
    (tmp_path / "f.stl").write_text("")
    assert read_folder(tmp_path).names == ("c", "d", "e", "f")
