"""Objects that are assembled of components are matched whole; fragments beside shapes are left out."""

import numpy as np
import pytest

import collalign
from collalign.output.loading import load
from data_tools.io.shapes import read_alike, write_mesh
from data_tools.options import SamplingOptions
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from tests.commands import read_json
from tests.finished_runs import angles_deg
from tests.notes import codes

OPTIONS = collalign.AlignOptions(group="SO", sampling=SamplingOptions(num_points=40))
#: Triangles of a grid of five by five corners.
_GRID = [
    corners
    for a in (*range(4), *range(5, 9), *range(10, 14), *range(15, 19))
    for corners in ((a, a + 1, a + 6), (a, a + 6, a + 5))
]


def box(size, centre):
    """Return a box of six grids (150 corners, as models have them) and its triangles."""
    u, v = (line.ravel() for line in np.meshgrid(*[np.linspace(-0.5, 0.5, 5)] * 2))
    sides = [
        np.roll(np.stack([u, v, np.full(25, end)], axis=1), axis, axis=1)
        for axis in range(3)
        for end in (-0.5, 0.5)
    ]
    faces = np.concatenate([np.array(_GRID) + 25 * i for i in range(6)])
    return np.concatenate(sides) * size + centre, faces


def assembled(boxes, name):
    """Return boxes that touch as one mesh."""
    starts = 150 * np.arange(len(boxes))
    vertices, faces = zip(*[box(np.array(size), np.array(at)) for size, at in boxes], strict=True)
    return Shape.from_arrays(
        np.concatenate(vertices),
        np.concatenate([f + start for f, start in zip(faces, starts, strict=True)]),
        name=name,
    )


def seat(rng, name):
    """Return a chair: a seat, a back, four legs and an arm at the right; its front is y, its top z."""
    width, depth, height = rng.uniform([0.8, 0.8, 0.7], [1.1, 1.1, 1.0])
    legs = [
        ((0.1, 0.1, height), (x * width / 2.3, y * depth / 2.3, -height / 2))
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    back = ((width, 0.1, 0.9), (0.0, -depth / 2, 0.45))
    arm = ((0.1, depth, 0.1), (width / 2, 0.0, 0.35))
    return assembled([((width, depth, 0.1), (0.0, 0.0, 0.0)), back, arm, *legs], name)


@pytest.fixture(scope="module")
def chairs(tmp_path_factory):
    """A folder of five chairs in random poses, and the rotations of these."""
    rng, folder = np.random.default_rng(0), tmp_path_factory.mktemp("chairs")
    turns = [random_rotation(rng) for _ in range(5)]
    for at, turn in enumerate(turns):
        shape = seat(rng, f"c{at}")
        write_mesh(folder / f"c{at}.ply", Shape.from_arrays(shape.vertices @ turn.T, shape.faces))
    return folder, turns


def test_chairs_of_many_boxes_are_aligned_by_all_of_them(chairs, tmp_path):
    folder, turns = chairs
    run = {"jobs": 1, "progress": False, "store": tmp_path / "store.sqlite"}
    found = collalign.align_collection(folder, options=OPTIONS, **run)
    assert "components-joined" in codes(found.notes)
    assert angles_deg(found.rotations @ turns)[0].max() < 10.0
    found.save(tmp_path / "out", report=False)
    recorded = read_json(tmp_path / "out" / "alignment.json")
    assert [shape.get("pieces") for shape in recorded["shapes"]] == ["all"] * 5
    loaded = load(tmp_path / "out")
    assert loaded.assembled == found.assembled == found.names
    assert [loaded.cleaning_of(at).components for at in range(5)] == ["all"] * 5
    seats = collalign.align_collection(
        folder, options=OPTIONS, cleaning={"components": "largest"}, **run
    )
    assert "components-joined" not in codes(seats.notes)
    assert angles_deg(seats.rotations @ turns)[0].max() > 20.0


def test_two_chairs_are_matched_by_all_of_their_boxes(chairs):
    folder, turns = chairs
    files = [folder / "c1.ply", folder / "c3.ply"]
    for matched in (collalign.match_rigid, collalign.match_in_part):
        found = matched(*files)
        rotation = found.transform[:3, :3] / np.cbrt(np.linalg.det(found.transform[:3, :3]))
        assert rotation_angle_deg(rotation @ turns[3] @ turns[1].T) < 10.0
    assert [len(shape.vertices) > 400 for shape in read_alike(files)] == [True, True]
