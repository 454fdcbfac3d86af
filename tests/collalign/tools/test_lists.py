"""Maps for a list of pairs: kept in the store, failures named, the command on top."""

from pathlib import Path

import numpy as np
import pytest

from collalign.cli import main
from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.products.shapes import Excluded
from collalign.tools.match.lists import FoundMap, MapOptions, match_surfaces, read_pairs
from collalign.tools.match.nonrigid import match_prepared
from collalign.tools.match.prepare import prepare_file
from data_tools.datasets.synthetic import bent
from data_tools.datasets.synthetic_shapes import figure
from data_tools.errors import InputError
from data_tools.io.shapes import write_mesh

OPTIONS = MapOptions(
    matching=NonrigidOptions(),
    surface=SurfaceOptions(num_functions=45, num_samples=60, num_dense=300),
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    body = figure()
    write_mesh(tmp_path / "a.ply", body)
    write_mesh(tmp_path / "b.ply", bent(body, rng, angle=0.6))
    (tmp_path / "pairs.txt").write_text("# target source\nb.ply a.ply\n\nmissing.ply b.ply  # not there\n")
    return tmp_path


def test_maps_are_found_once_and_failures_named(folder: Path) -> None:
    pairs = read_pairs(folder / "pairs.txt")
    run = RunOptions(jobs=1, store=folder / "store.sqlite")
    with Session.open(OPTIONS, run) as session:
        good, bad = match_surfaces(session, pairs)
    assert isinstance(good, FoundMap)
    assert isinstance(bad, Excluded)
    assert "missing" in bad.reason
    direct = match_prepared(*(prepare_file(file, OPTIONS.surface) for file in pairs[0]), OPTIONS.matching)
    assert good.text == direct.text_bytes()
    with Session.open(OPTIONS, run) as session:
        assert len(session.stored["pairs"]) == 1
        assert match_surfaces(session, pairs)[0] == good


def test_pair_lists_are_checked(tmp_path: Path) -> None:
    (tmp_path / "bad.txt").write_text("a.ply b.ply c.ply\n")
    (tmp_path / "empty.txt").write_text("# nothing\n")
    with pytest.raises(InputError, match="line 1"):
        read_pairs(tmp_path / "bad.txt")
    with pytest.raises(InputError, match="no pairs"):
        read_pairs(tmp_path / "empty.txt")


def test_the_command_matches_a_list(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    small = ["--surface.num-functions", "45", "--surface.num-samples", "60"]
    words = ["maps", str(folder / "pairs.txt"), "--out", str(folder / "maps"), "--jobs", "1", *small]
    assert main([*words, "--surface.num-dense", "300"]) == 3
    printed = capsys.readouterr()
    assert "1 of 2 maps" in printed.out
    assert "missing.ply" in printed.err
    assert (folder / "maps" / "b__a.txt").is_file()
