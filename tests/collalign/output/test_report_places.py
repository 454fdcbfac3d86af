"""What files, report and its pages know of the maps of all vertices: a colour by place for every vertex."""

import dataclasses

import numpy as np
import pytest

from collalign.output.loading import load
from collalign.output.report.content import build_content, place_meshes
from data_tools.errors import InputError
from tests.collalign.output.test_report_content import unpack
from tests.view_problems import view_of, write_result

#: The shape without maps.
WITHOUT = 2


def mapped_view():
    """A collection of which all shapes but one have maps of all vertices, the last one's in doubt."""
    view = view_of(4)
    rng = np.random.default_rng(0)
    places = [
        rng.integers(0, 256, (len(vertices), 4), dtype=np.uint8) for vertices in view.vertices
    ]
    places[WITHOUT] = np.empty((0, 4), dtype=np.uint8)
    places[-1][:, 3] = 51
    return dataclasses.replace(view, places=tuple(places))


def test_every_shape_with_maps_is_drawn_in_its_colours():
    view = mapped_view()
    document, blobs = build_content(view)
    assert [place and place["mesh"] for place in document["places"]] == [
        "place-0",
        "place-1",
        None,
        "place-3",
    ]
    assert document["places"][3]["sure"] == pytest.approx(0.2)
    for at, (info, text) in ((at, place_meshes(view)[f"place-{at}"]) for at in (0, 1, 3)):
        assert np.array_equal(
            unpack(info["fields"], text)["scalars"].reshape(-1, 4), view.places[at]
        )
        assert f"mesh-place-{at}" in blobs
    assert build_content(view_of(4))[0]["places"] == []


def test_colours_come_back_from_the_file_and_impossible_ones_do_not(tmp_path):
    view = mapped_view()
    write_result(view, tmp_path / "right")
    back = load(tmp_path / "right")
    assert all(np.array_equal(a, b) for a, b in zip(back.places, view.places, strict=True))
    write_result(view_of(4), tmp_path / "none")
    assert load(tmp_path / "none").places == ()
    write_result(
        dataclasses.replace(view, places=(view.places[0][:-1], *view.places[1:])),
        tmp_path / "wrong",
    )
    with pytest.raises(InputError, match="places"):
        load(tmp_path / "wrong")
