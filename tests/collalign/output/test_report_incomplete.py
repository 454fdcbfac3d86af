"""What the page says and draws of incomplete shapes."""

import dataclasses

import numpy as np
import pytest

from collalign.output.report.sections import counterparts_on, incomplete_content
from collalign.output.write import _incomplete
from collalign.products.shapes import Incomplete
from data_tools.poses import moved_by
from tests.collalign.output.test_report_content import unpack
from tests.view_problems import view_of

BROKEN = 3


def broken_view(*, every=False):
    """A collection of which one shape lacks what lies beyond a plane; with ``every`` all count as incomplete."""
    view = view_of(6, subdivisions=3)
    T = view.transforms[BROKEN]
    posed = view.vertices[BROKEN] @ T[:3, :3].T + T[:3, 3]
    placed = view.aligned_landmarks[BROKEN]
    height = np.quantile(posed[:, 0], 0.7)
    kept = posed[:, 0] <= height
    faces = (np.cumsum(kept) - 1)[view.faces[BROKEN][kept[view.faces[BROKEN]].all(axis=1)]]
    samples = view.landmarks.copy()
    samples[BROKEN][placed[:, 0] > height] = np.nan
    partners = np.array([0, 1, 2])
    incomplete = Incomplete(
        shape=BROKEN, reason="named", partners=partners, overlaps=np.full((3, 2), [0.7, 1.0])
    )
    others = [
        Incomplete(shape=i, reason="", partners=np.array([BROKEN]), overlaps=np.ones((1, 2)))
        for i in range(6)
        if every and i != BROKEN
    ]
    return dataclasses.replace(
        view,
        vertices=(
            *view.vertices[:BROKEN],
            view.vertices[BROKEN][kept],
            *view.vertices[BROKEN + 1 :],
        ),
        faces=(*view.faces[:BROKEN], faces, *view.faces[BROKEN + 1 :]),
        samples=samples,
        incomplete=(incomplete, *others),
    )


def mesh_of(meshes, name):
    """Return the vertices and the values of a packed mesh."""
    info, text = meshes[name]
    arrays = unpack(info["fields"], text)
    return np.array(info["centre"]) + info["step"] * arrays["vertices"].reshape(-1, 3), arrays[
        "scalars"
    ] / 255.0


def test_colours_tell_where_the_plane_was():
    view = broken_view()
    content, meshes = incomplete_content(view)
    (entry,) = content["shapes"]
    assert entry["coverage"] == pytest.approx(0.7)
    assert entry["own"] == f"coverage-{BROKEN}"
    whole, broken = (moved_by(view.transforms[at], view.vertices[at]) for at in (0, BROKEN))
    vertices, shares = mesh_of(meshes, f"coverage-{BROKEN}")
    assert len(shares) == len(vertices)
    lengths = {name: length for name, _, length in meshes[f"coverage-{BROKEN}"][0]["fields"]}
    assert lengths["samples"] == 0
    assert shares.min() == 1.0
    beyond, found = (
        whole[:, 0] - broken[:, 0].max(),
        counterparts_on(broken, view.faces[BROKEN])(whole),
    )
    assert not found[beyond > 0.15].any()
    assert found[beyond < -0.05].all()


def test_the_record_counts_what_the_arrays_hold():
    view = broken_view()
    labels = view.maps.labels.copy()
    labels[BROKEN, 5:] = -1  # label 0 among those that stay
    view = dataclasses.replace(view, maps=dataclasses.replace(view.maps, labels=labels))
    (told,) = _incomplete(view)["incomplete"]
    assert (told["name"], told["reason"], told["samples_with_labels"]) == (
        view.names[BROKEN],
        "named",
        5,
    )
    assert told["coverage"] == pytest.approx(view.incomplete[0].coverage)
    assert told["overlaps"] == {view.names[i]: {"partner": 0.7, "own": 1.0} for i in (0, 1, 2)}
    np.testing.assert_allclose(told["translation"], view.transforms[BROKEN][:3, 3])
    assert told["scale"] == pytest.approx(view.scales[BROKEN])
