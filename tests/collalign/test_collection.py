"""What a person does with a result in a notebook, just made or read from its folder."""

import pickle
import re
import sys
from base64 import b64decode
from dataclasses import replace

import numpy as np
import pytest

import collalign
from data_tools.errors import InputError, UnavailableError
from data_tools.options import SamplingOptions
from tests.finished_runs import chairs


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("result") / "out"


@pytest.fixture(scope="module")
def made(folder):
    shapes = chairs(3).shapes
    named = {"<one>": shapes[0], "two": shapes[1], "points": shapes[2].vertices}
    options = {"seed": 3, "maps": "never", "sampling": {"num_points": 16, "num_dense_points": 0}}
    aligned = collalign.align_collection(named, options=options, seed=1, jobs=1, progress=False)
    aligned.save(folder, report=False)
    return aligned


@pytest.fixture(params=["made", "loaded"])
def result(request, made, folder):
    return made if request.param == "made" else collalign.load(folder)


def test_options_may_be_keywords_which_win_and_tables(result):
    sampling = SamplingOptions(num_points=16, num_dense_points=0)
    assert result.options == collalign.AlignOptions(seed=1, maps="never", sampling=sampling)


def test_shapes_are_found_by_name_and_position(result, made):
    assert len(result) == 3
    assert [shape.name for shape in result] == list(made.names) == ["<one>", "points", "two"]
    np.testing.assert_array_equal(result["two"].transform, made.transforms[2])
    assert result[-1].name == "two"
    assert result["two"].confidence == made.confidence[2]
    assert result["two"].file == ""
    assert [shape.name for shape in result[1:]] == ["points", "two"]
    assert ("two" in result, "nobody" in result, result["two"] in result) == (True, False, True)
    for error in (InputError, KeyError):
        with pytest.raises(
            error, match=r"^no shape is called 'nobody'; the collection has <one>, points, two$"
        ):
            result["nobody"]
    with pytest.raises(IndexError):
        result[3]


def test_maps_poses_and_pairs_are_asked_by_name(result, made):
    assert np.array_equal(result.maps["two", "<one>"], made.maps["two", "<one>"])
    assert np.array_equal(result.maps.labels, made.maps.labels)
    np.testing.assert_allclose(result.rotations, made.rotations, atol=1e-12)
    assert np.array_equal(result.reflected, made.reflected)
    assert result.pairs["two", "<one>"] is result.pairs["<one>", "two"]
    assert result.pairs["two", "points"].energy == made.pairs["two", "points"].energy
    assert {("two", "points")} == {
        pair for pair in (("two", "points"), ("two", "two")) if pair in result.pairs
    }
    assert result.pairs[0] in result.pairs
    assert len(result.pairs[1:]) == 2
    assert (
        pickle.loads(pickle.dumps(result.pairs))["two", "points"].target
        == result.pairs["two", "points"].target
    )
    with pytest.raises(KeyError, match="two and nobody were not matched"):
        result.pairs["two", "nobody"]
    with pytest.raises(KeyError, match="'nobody'"):
        result.maps["nobody", "two"]
    with pytest.raises(InputError, match="deformable"):
        result.vertex_maps  # noqa: B018
    for one in (result.maps, result.pairs[0], result["two"]):
        assert "\n" not in repr(one)
        assert len(repr(one)) < 500


def test_damaged_maps_of_a_folder_are_refused(made, tmp_path):
    made.save(tmp_path / "out", report=False)
    file = tmp_path / "out" / "correspondences.npz"
    with np.load(file) as found:
        arrays = dict(found)
    for name, wrong in (
        ("labels", np.zeros((2, 16), dtype=int)),
        ("labels", np.full_like(arrays["labels"], 16)),
        ("positions", arrays["positions"] * np.nan),
        ("vertex_indices", arrays["vertex_indices"][:, 1:]),
    ):
        np.savez_compressed(file, **arrays | {name: wrong})
        with pytest.raises(InputError, match=rf"correspondences\.npz: damaged.*{name}"):
            collalign.load(tmp_path / "out")
    file.write_bytes(b"no archive")
    with pytest.raises(InputError, match=r"correspondences\.npz"):
        collalign.load(tmp_path / "out")


def test_a_loaded_result_says_that_it_is_saved(folder, made, tmp_path):
    with pytest.raises(InputError, match="copy this folder"):
        collalign.load(folder).save(tmp_path / "again")


def test_it_introduces_itself_in_a_line_and_a_notebook_shows_pictures(result):
    assert repr(result).startswith(f"<{type(result).__name__}: 3 shapes, 3 pairs, ")
    assert len(repr(result)) < 100
    doubtful = replace(result, confidence=np.array([0.5, np.nan, 1.0]))
    shown = doubtful._repr_html_()
    assert re.findall("<td>(.*?)</td>", shown) == ["points", "unknown", "&lt;one&gt;", "50 %"]
    assert "<one>" not in shown
    assert b64decode(re.search('src="data:image/png;base64,(.*?)"', shown)[1]).startswith(
        b"\x89PNG"
    )
    assert '<iframe sandbox="allow-scripts allow-downloads"' in shown
    assert "<table" not in replace(result, confidence=np.ones(3))._repr_html_()
    assert (
        "iframe"
        not in replace(result, fresh=None, folder=None, vertices=(), faces=())._repr_html_()
    )


def test_the_report_opens_in_the_browser_and_in_a_frame_of_a_notebook(result, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    report = result.report()
    assert opened == [report.path.as_uri()]
    assert "&lt;title&gt;" in report._repr_html_()
    monkeypatch.setitem(sys.modules, "ipykernel", None)
    assert result.report().path != report.path
    assert len(opened) == 1


def test_lists_of_shapes_and_pairs_are_tables(result):
    shapes, pairs = result.to_dataframe(), result.to_dataframe("pairs")
    assert shapes["name"].tolist() == list(result.names)
    assert shapes["confidence"][result.index("two")] == result["two"].confidence
    assert pairs["energy"].tolist() == [pair.energy for pair in result.pairs]


def test_without_open3d_it_says_what_to_install(result, tmp_path, monkeypatch):
    monkeypatch.delitem(sys.modules, "open3d", raising=False)
    (tmp_path / "open3d.py").write_text("raise ImportError('libusb-1.0.so.0: cannot open it')")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(UnavailableError, match=r"libusb-1\.0.*pip install 'collalign\[open3d\]'"):
        result.to_open3d()
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(InputError, match=r"open3d.*pip install 'collalign\[open3d\]'"):
        result.to_open3d()
