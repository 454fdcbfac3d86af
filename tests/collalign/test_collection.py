"""What a person does with a result in a notebook, just made or read from its folder."""

from __future__ import annotations

import pickle
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import collalign
from data_tools.datasets.synthetic import deformed_family, planted_collection
from data_tools.datasets.synthetic_shapes import chair
from data_tools.errors import InputError, OptionsError, UnavailableError
from data_tools.options import SamplingOptions


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("result") / "out"


@pytest.fixture(scope="module")
def made(folder: Path) -> collalign.AlignedCollection:
    rng = np.random.default_rng(5)
    shapes = planted_collection(deformed_family(chair(rng, resolution=1), 3, rng, rms=0.02), rng).shapes
    named = {"<one>": shapes[0], "two": shapes[1], "points": shapes[2].vertices}
    options = collalign.AlignOptions(sampling=SamplingOptions(num_points=16, num_dense_points=0))
    aligned = collalign.align_collection(named, options=options, run=collalign.RunOptions(jobs=1), progress=False)
    aligned.save(folder, report=False)
    return aligned


@pytest.fixture(params=["made", "loaded"])
def result(
    request: pytest.FixtureRequest, made: collalign.AlignedCollection, folder: Path
) -> collalign.AlignedCollection | collalign.LoadedCollection:
    return made if request.param == "made" else collalign.load(folder)


Result = collalign.AlignedCollection | collalign.LoadedCollection


def test_shapes_are_found_by_name_and_position(result: Result, made: collalign.AlignedCollection) -> None:
    assert len(result) == 3
    assert [shape.name for shape in result] == list(made.names) == ["<one>", "points", "two"]
    np.testing.assert_array_equal(result["two"].transform, made.transforms[2])
    assert result[-1].name == "two"
    assert result["two"].confidence == made.confidence[2]
    assert result["two"].file == ""
    assert [shape.name for shape in result[1:]] == ["points", "two"]
    assert ("two" in result, "nobody" in result, result["two"] in result) == (True, False, True)
    for error in (InputError, KeyError):
        with pytest.raises(error, match=r"^no shape is called 'nobody'; the collection has <one>, points, two$"):
            result["nobody"]
    with pytest.raises(IndexError):
        result[3]


def test_maps_poses_and_pairs_are_asked_by_name(result: Result, made: collalign.AlignedCollection) -> None:
    assert np.array_equal(result.maps["two", "<one>"], made.maps["two", "<one>"])
    assert np.array_equal(result.maps.labels, made.maps.labels)
    np.testing.assert_allclose(result.rotations, made.rotations, atol=1e-12)
    assert np.array_equal(result.reflected, made.reflected)
    assert result.pairs["two", "<one>"] is result.pairs["<one>", "two"]
    assert result.pairs["two", "points"].energy == made.pairs["two", "points"].energy
    assert {("two", "points")} == {pair for pair in (("two", "points"), ("two", "two")) if pair in result.pairs}
    assert result.pairs[0] in result.pairs
    assert len(result.pairs[1:]) == 2
    assert pickle.loads(pickle.dumps(result.pairs))["two", "points"].target == result.pairs["two", "points"].target
    with pytest.raises(KeyError, match="two and nobody were not matched"):
        result.pairs["two", "nobody"]
    with pytest.raises(KeyError, match="'nobody'"):
        result.maps["nobody", "two"]
    with pytest.raises(InputError, match="deformable"):
        result.vertex_maps  # noqa: B018
    for one in (result.maps, result.pairs[0], result["two"]):
        assert "\n" not in repr(one)
        assert len(repr(one)) < 500


def test_damaged_maps_of_a_folder_are_refused(made: collalign.AlignedCollection, tmp_path: Path) -> None:
    made.save(tmp_path / "out", report=False)
    file = tmp_path / "out" / "correspondences.npz"
    np.savez_compressed(file, labels=np.zeros((2, 16)))
    with pytest.raises(InputError, match="labels"):
        collalign.load(tmp_path / "out").maps  # noqa: B018
    file.write_bytes(b"no archive")
    with pytest.raises(InputError, match=r"correspondences\.npz"):
        collalign.load(tmp_path / "out").maps  # noqa: B018


def test_it_introduces_itself_in_a_line_and_in_html(result: Result) -> None:
    assert repr(result).startswith(f"<{type(result).__name__}: 3 shapes, 3 pairs, ")
    assert len(repr(result)) < 100
    page = result._repr_html_()
    tags: list[str] = []
    parser = HTMLParser()
    parser.handle_starttag = lambda tag, attrs: tags.append(tag)  # type: ignore[method-assign]
    parser.feed(page)
    assert tags.count("tr") == 4
    assert tags.count("img") == 1
    assert "one" not in tags
    assert "&lt;one&gt;" in page


def test_tables_hold_shapes_and_pairs(result: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    shapes, pairs = result.to_dataframe(), result.to_dataframe("pairs")
    assert list(shapes.index) == list(result.names)
    assert shapes.loc["two", "confidence"] == result["two"].confidence
    assert len(pairs) == len(result.pairs)
    assert pairs["energy"].tolist() == [pair.energy for pair in result.pairs]
    with pytest.raises(OptionsError, match="'shapes' or 'pairs'"):
        result.to_dataframe("maps")  # type: ignore[arg-type]
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(UnavailableError, match=r"collalign\[tables\]"):
        result.to_dataframe()


def test_meshes_lie_in_the_common_frame(result: Result, made: collalign.AlignedCollection) -> None:
    meshes = result.aligned_meshes()
    assert [type(mesh).__name__ for mesh in meshes.values()] == ["Trimesh", "PointCloud", "Trimesh"]
    for at, mesh in enumerate(meshes.values()):
        np.testing.assert_allclose(
            np.asarray(mesh.vertices)[made.samples[at]], made.positions[at], atol=1e-5 * np.ptp(made.positions)
        )
    assert list(result.aligned_meshes(["two"])) == ["two"]


def test_the_plot_has_two_pictures_of_each_shape(result: Result) -> None:
    figure = result.plot(["two", 0])
    words = [text.get_text() for text in figure.axes[0].texts]
    assert words[::2] == ["two", "<one>"]


def test_a_folder_without_a_result_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no such file"):
        collalign.load(tmp_path)
