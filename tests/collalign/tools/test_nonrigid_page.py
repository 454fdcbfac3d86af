"""Maps between files become maps between shapes whose unused vertices were dropped."""

from dataclasses import replace
from importlib import resources
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from collalign.tools.match.map_page import vertices_map, write_match_page
from data_tools.surface.shape import Shape


def shape_without(dropped: list[int], num: int) -> Shape:
    """Return a shape that kept the vertices of a file of ``num`` that are not dropped."""
    kept = np.setdiff1d(np.arange(num), dropped)
    shape = Shape.from_arrays(np.random.default_rng(0).random((len(kept), 3)))
    return replace(shape, source_indices=kept)


def test_dropped_vertices_are_renumbered() -> None:
    target, source = shape_without([1], 4), shape_without([0], 3)
    point_map = np.array([-1, 3, 0])
    assert vertices_map(point_map, target, source).tolist() == [2, 0]
    assert vertices_map(np.array([0, 1, -1]), target, source).tolist() == [-1, -1]


def test_complete_shapes_keep_their_map() -> None:
    shape = Shape.from_arrays(np.random.default_rng(0).random((5, 3)))
    point_map = np.array([4, 3, 2, -1, 0])
    assert np.array_equal(vertices_map(point_map, shape, shape), point_map)


def test_the_page_loads_and_sends_nothing(tmp_path: Path) -> None:
    shape = Shape.from_arrays(np.random.default_rng(0).random((30, 3)))
    match: Any = SimpleNamespace(
        point_map_target_source=np.arange(30), candidates=(), target_name="<b>", source_name="cat", notes=("A & B",),
        confidence=0.5, orientation="preserving", bijectivity=0.9, vertex_confidence=np.full(30, 0.5),
    )  # fmt: skip
    page = write_match_page(tmp_path / "map.html", match, shape, shape).read_text(encoding="utf-8")
    assert "default-src 'none'; script-src 'none'; style-src 'unsafe-inline'; img-src data:" in page
    assert (
        "default-src 'none'"
        in resources.files("collalign.output.report").joinpath("viewer/template.html").read_text()
    )
    assert "<b>" not in page
    assert "A &amp; B" in page
    assert "http" not in page.split("<body>")[1]
    assert "prefers-color-scheme: dark" in page
    assert "max-width: 40rem" in page
