import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from collalign.output.evidence.file import save_view
from collalign.output.window import scene, view
from data_tools.errors import InputError
from tests.view_problems import view_of


def test_overlay_and_grid_show_the_common_frame() -> None:
    data = view_of(5, num_missing=2)
    entries = {arguments[0]: arguments for _, arguments, _ in scene(data, [0, 3], overlay=True)}
    assert list(entries) == ["shape_000", "shape_000 samples", "shape_003", "shape_003 samples"]
    T = data.transforms[3]
    np.testing.assert_allclose(entries["shape_003"][1], data.vertices[3] @ T[:3, :3].T + T[:3, 3], atol=1e-12)
    assert len(entries["shape_000 samples"][1]) == data.samples.shape[1] - 1
    placed = [arguments[1] for kind, arguments, _ in scene(data, range(5), overlay=False) if kind == "mesh"]
    boxes = [(points.min(axis=0), points.max(axis=0)) for points in placed]
    for a, one in enumerate(boxes):
        for other in boxes[a + 1 :]:
            assert (one[1] < other[0]).any() or (other[1] < one[0]).any()


def test_colours_follow_labels_across_shapes() -> None:
    samples = [options["colors"] for kind, _, options in scene(view_of(3), [0, 1], overlay=True) if kind == "points"]
    np.testing.assert_array_equal(samples[0], samples[1])
    assert len(np.unique(samples[0], axis=0)) == len(samples[0])


def test_window_holds_every_structure(tmp_path: Path) -> None:
    polyscope: Any = pytest.importorskip("polyscope", reason="polyscope is not installed")
    save_view(view_of(3), tmp_path)
    view(tmp_path, names=["shape_002"], backend="openGL_mock", show=False)
    assert polyscope.has_surface_mesh("shape_002")
    assert polyscope.has_point_cloud("shape_002 samples")
    assert not polyscope.has_surface_mesh("shape_000")


def test_unknown_names_are_refused() -> None:
    with pytest.raises(InputError, match="no shape of this collection"):
        view(view_of(3), names=["nobody"])


def test_an_impossible_window_is_said_with_advice() -> None:
    pytest.importorskip("polyscope", reason="polyscope is not installed")
    with pytest.raises(InputError, match=r"report\.html"):
        view(view_of(3), backend="none such")


def test_missing_polyscope_is_said_with_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "polyscope", None)
    with pytest.raises(InputError, match="pip install"):
        view(view_of(3))
