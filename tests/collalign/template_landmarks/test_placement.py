"""Landmarks are brought into their template's coordinates, and refused with a remedy where they do not lie on it."""

from dataclasses import replace

import numpy as np
import pytest

from collalign.template_landmarks.on_surface import place_templates
from data_tools.datasets.synthetic_shapes import chair
from data_tools.embedding.sampling import farthest_points
from data_tools.errors import InputError
from data_tools.io.shapes import LPS_RAS, write_mesh
from data_tools.landmark_files import Landmarks, Semilandmarks
from data_tools.notes import Note
from data_tools.poses import moved_by
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from tests.finished_runs import radius
from tests.notes import codes, only

SEAT = chair(np.random.default_rng(1), resolution=1)
#: Away from its origin, as scans are.
SHAPE = Shape.from_arrays(SEAT.vertices + np.array([0.4, 0.3, 0.2]), SEAT.faces, name="a")
OTHER = Shape.from_arrays(SHAPE.vertices * [1.0, 1.3, 0.7] + 3.0, SHAPE.faces, name="b")
ROWS = farthest_points(SHAPE, 8, metric="euclidean")
POINTS = SHAPE.vertices[ROWS]
RADIUS = radius(SHAPE.vertices)


def marks(points, system=None):
    return Landmarks(
        labels=tuple(f"L{at}" for at in range(len(points))), points=points, system=system
    )


def placed(tmp_path, given, *, declared="", shape=SHAPE):
    file = write_mesh(tmp_path / "a.ply", shape)
    if declared:
        file.write_bytes(
            file.read_bytes().replace(
                b"\nelement", f"\ncomment SPACE={declared}\nelement".encode(), 1
            )
        )
    return place_templates(
        {"a": given}, {"a": file}, [(one.name, one.vertices, one.faces) for one in (SHAPE, OTHER)]
    )


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_landmarks_on_their_template_stay_as_they_are(tmp_path, noise):
    points = POINTS + noise * RADIUS * np.random.default_rng(0).standard_normal(POINTS.shape)
    points[2] = np.nan
    found = placed(tmp_path, marks(points))
    np.testing.assert_array_equal(found[0]["a"].points, points)
    assert (found[1], found[2]) == ((), "LPS")


def test_markups_that_are_no_landmarks_are_named(tmp_path):
    given = replace(marks(POINTS), left_out=("Plane", "ROI"))
    assert placed(tmp_path, given)[1] == (
        Note("no-landmarks", ("a",), {"kinds": ("Plane", "ROI")}),
    )


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (POINTS * 10, r"0.1 times as large"),
        (POINTS / 1000, r"1000 times as large"),
        (POINTS / 25.4, r"25.4 times as large"),
        (POINTS * LPS_RAS, r"RAS.*LPS"),
        (OTHER.vertices[ROWS], r"on b: .*another specimen"),
        (POINTS + 5 * RADIUS, r"Check the specimen"),
        ((POINTS * 10)[:1], r"not on its surface"),
    ],
)
def test_landmarks_off_their_template_are_refused_with_the_remedy(tmp_path, points, words):
    with pytest.raises(InputError, match=words) as caught:
        placed(tmp_path, marks(points))
    assert str(caught.value).startswith("a: its landmarks are not on its surface")


@pytest.mark.parametrize("size", [0.3, 1.0])
def test_landmarks_in_the_common_frame_are_refused_with_what_to_write(tmp_path, rng, size):
    """As exports for statistics are: scaled like the result, or in the unit of the file."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = 0.3 * random_rotation(rng), rng.random(3) + 1.0
    file = write_mesh(tmp_path / "a.ply", SHAPE)
    given = {"a": marks(moved_by(pose, POINTS) * size / 0.3)}
    with pytest.raises(InputError, match=r"common frame of the result.*--space raw"):
        place_templates(given, {"a": file}, (), transforms={"a": pose})
    with pytest.raises(InputError, match="Check the specimen"):
        place_templates(given, {"a": file}, (), transforms={"a": np.eye(4)})


@pytest.mark.parametrize("of_mesh", ["", "LPS", "RAS"])
@pytest.mark.parametrize("said", ["LPS", "RAS"])
def test_a_declared_system_is_converted_to_the_template_s(tmp_path, of_mesh, said):
    """The mesh's numbers are those of its own system, LPS unless its header says RAS."""
    same = said == (of_mesh or "LPS")
    given = POINTS if same else POINTS * LPS_RAS
    curve = Semilandmarks(name="rim", kind="open curve", points=given[:4], system=said)
    found = placed(tmp_path, replace(marks(given, said), semilandmarks=(curve,)), declared=of_mesh)
    np.testing.assert_allclose(found[0]["a"].points, POINTS)
    np.testing.assert_allclose(found[0]["a"].semilandmarks[0].points, POINTS[:4])
    assert ("landmarks-converted" in codes(found[1])) == (not same)
    assert found[2] == "LPS"


def test_a_declaration_of_the_mesh_is_not_overruled(tmp_path):
    with pytest.raises(InputError, match="RAS"):
        placed(tmp_path, marks(POINTS, "RAS"), declared="LPS")


def test_single_landmarks_off_the_surface_are_named(tmp_path):
    points = np.array(POINTS)
    points[3] += 0.5 * RADIUS
    found = placed(tmp_path, marks(points))
    np.testing.assert_array_equal(found[0]["a"].points, points)
    (note,) = found[1]
    assert (note.code, note.shapes, note.values["labels"]) == (
        "landmarks-off-surface",
        ("a",),
        ("L3",),
    )


@pytest.mark.parametrize("far", [20.0, 1e6])
def test_landmarks_farther_than_a_radius_from_the_surface_are_missing(tmp_path, far):
    points = np.array(POINTS)
    points[3, 0] += far * RADIUS
    found = placed(tmp_path, marks(points))
    assert np.isnan(found[0]["a"].points).all(axis=1).tolist() == [
        at == 3 for at in range(len(POINTS))
    ]
    assert found[1] == (Note("landmarks-too-far", ("a",), {"labels": ("L3",)}),)


@pytest.mark.parametrize("code", [-999.0, 9999.0, -1.0, 0.0, -32768.0, 1e30])
@pytest.mark.parametrize("system", [None, "RAS"])
def test_codes_for_missing_landmarks_are_no_landmarks(tmp_path, code, system):
    """Even most landmarks may be missing, and 3D Slicer changes signs of codes with the system."""
    points = POINTS * LPS_RAS if system else np.array(POINTS)
    points[:5] = code
    found = placed(tmp_path, marks(points, system), declared="LPS" if system else "")
    np.testing.assert_allclose(found[0]["a"].points[5:], POINTS[5:])
    assert np.isnan(found[0]["a"].points[:5]).all()
    assert only(found[1], "landmark-codes").values["labels"] == ("L0", "L1", "L2", "L3", "L4")
    points[:] = code
    with pytest.raises(InputError, match="no landmark is on the surface"):
        placed(tmp_path, marks(points, system), declared="LPS" if system else "")


def test_points_of_curves_that_are_codes_are_left_out_and_of_patches_missing(tmp_path):
    points = np.array(POINTS[:6])
    points[2] = -999
    lines = [Semilandmarks(name=kind, kind=kind, points=points) for kind in ("open curve", "patch")]
    found = placed(tmp_path, replace(marks(POINTS), semilandmarks=tuple(lines)))
    curve, patch = found[0]["a"].semilandmarks
    np.testing.assert_array_equal(curve.points, np.delete(points, 2, axis=0))
    assert np.isnan(patch.points).all(axis=1).tolist() == [False, False, True, False, False, False]
    assert found[1][0].values["labels"] == ("open curve-3", "patch-3")
    rim = Semilandmarks(name="rim", kind="open curve", points=points[1:3])
    with pytest.raises(InputError, match="a: the curve 'rim' has 1 points"):
        placed(tmp_path, replace(marks(POINTS), semilandmarks=(rim,)))


def test_between_the_points_of_a_cloud_landmarks_are_on_it(tmp_path):
    rng = np.random.default_rng(2)
    directions = rng.standard_normal((2000, 3))
    sphere = directions / np.linalg.norm(directions, axis=1)[:, None] * [1.0, 2.0, 3.0]
    cloud = Shape.from_arrays(sphere[:300], name="a")
    assert placed(tmp_path, marks(sphere[300:330]), shape=cloud)[1] == ()
    with pytest.raises(InputError, match="are not on its surface"):
        placed(tmp_path, marks(sphere[300:330] * 2.0), shape=cloud)
