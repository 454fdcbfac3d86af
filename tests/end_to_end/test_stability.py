"""The check of a result's stability, as a user runs it, on generated shapes."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import collalign
from collalign.align import align_listing
from collalign.engine.store import Store
from collalign.options import AlignOptions
from collalign.output.loading import load
from collalign.tools.stability.command import stability_summary, write_stability_page
from collalign.tools.stability.run import StabilityOptions
from data_tools.errors import InputError
from data_tools.options import SamplingOptions
from tests.commands import read_rows, run_command
from tests.finished_runs import chairs, finished_run, made_once
from tests.view_problems import write_result

FEW = [
    "--num-points",
    "24",
    "--num-seeds",
    "1",
    "--num-subsets",
    "1",
    "--jobs",
    "1",
    "--include-doubtful",
]
OPTIONS = AlignOptions(sampling=SamplingOptions(num_points=16, num_dense_points=200))


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """A finished result of five chairs, with its store."""
    return finished_run(tmp_path_factory.mktemp("stability"), chairs(5), OPTIONS)


def test_the_command_writes_tables_and_picture_and_goes_on_from_the_store(result):
    before = {
        path.name: path.read_bytes()
        for path in result.iterdir()
        if path.suffix in (".json", ".npz", ".csv")
    }
    said = run_command("stability", result, *FEW).out.splitlines()
    assert said[0] == "5 of 5 poses stayed within 20 deg of the others' in every repetition."
    assert said[1] == "5 shapes aligned again 3 times: 4 shapes, choice 1; seed 1; 24 points."
    names = ["stability.csv", "stability.html"]
    assert sorted(Path(line).name for line in said[-2:]) == names
    page = (result / "stability.html").read_text()
    assert "5 shapes aligned again 3 times" in page
    assert "Of the 0 shapes" not in page
    assert 'href="report.html"' in page
    assert page.count("<tr>") == 6
    assert page.count("<td>100 %</td>") >= 5
    assert "data:image/png;base64," in page
    assert {name: (result / name).read_bytes() for name in before} == before
    with Store.open(result / "store.sqlite") as store:
        num_pairs = len(store.keys("pairs"))
    rows = read_rows(result / "stability.csv")
    assert [float(row["pose_stays"]) for row in rows] == [1.0] * 5
    assert sorted(row["repetitions"] for row in rows) == ["2", "3", "3", "3", "3"]
    first = (result / "stability.csv").read_bytes()
    run_command("stability", result, *FEW)
    assert (result / "stability.csv").read_bytes() == first
    with Store.open(result / "store.sqlite") as store:
        assert len(store.keys("pairs")) == num_pairs


def test_a_pose_that_only_the_result_has_is_found(result, tmp_path, monkeypatch):
    align_once = made_once(align_listing, lambda session, listing: (session.options, listing.names))
    monkeypatch.setattr(
        "collalign.tools.stability.run.align_listing", align_once
    )  # all checks repeat the same two
    view = load(result)
    transforms = view.transforms.copy()
    transforms[2, :3, :3] = np.diag([-1.0, -1.0, 1.0]) @ transforms[2, :3, :3]
    sure = np.full(5, 0.99)
    write_result(replace(view, transforms=transforms, confidence=sure), tmp_path)
    few = StabilityOptions(num_points=(), num_seeds=1, num_subsets=1)
    run = collalign.RunOptions(jobs=1, store=result / "store.sqlite")
    found = collalign.check_stability(tmp_path, options=few, run=run, progress=False)
    stays = found.pose_stays
    assert stays[2] == 0.0
    assert (np.delete(stays, 2) == 1.0).all()
    assert found.chirality_stays.min() == 1.0
    assert f"{view.names[2]} (0 %)" in stability_summary(found)[1]
    page = write_stability_page(found, b"", tmp_path / "page.html").read_text()
    first = page.split("<tr>")[2]
    assert first.startswith(f"<td>{view.names[2]}</td>")  # the least stable shape comes first
    assert "<td>0 %</td>" in first
    assert stability_summary(found)[0].startswith("4 of 5 poses")
    doubted = sure.copy()
    doubted[2] = 0.3
    write_result(replace(view, transforms=transforms, confidence=doubted), tmp_path)
    found = collalign.check_stability(tmp_path, options=few, run=run, progress=False)
    lines = stability_summary(found)
    assert lines[0].startswith("4 of 4 poses")
    assert f"Left out of the statistics: {view.names[2]} (in doubt)." in lines


def test_a_vanished_file_and_a_file_of_somebody_else_are_named(result, tmp_path):
    copy = tmp_path / "out"
    shutil.copytree(result, copy)
    view = load(result)
    write_result(replace(view, files=(*view.files[:-1], str(tmp_path / "gone.ply"))), copy)
    with pytest.raises(
        InputError, match=r"gone\.ply: a shape of the collection is not there any more"
    ):
        collalign.check_stability(copy)
    write_result(view, copy)
    (copy / "stability.csv").write_text("mine")
    run_command("stability", copy, *FEW, ends=2)
    assert (copy / "stability.csv").read_text() == "mine"
