"""Extra material, such as a stand: found, named, ignored by poses, and left out of correspondences on request."""

from dataclasses import replace

import numpy as np
import pytest

from collalign import AlignOptions, align_collection, load, note_text
from collalign.output.report.content import build_content
from collalign.stages.extra_material import Disks, extra_points
from data_tools.datasets.synthetic import deformed_family
from data_tools.datasets.synthetic_shapes import blob, sphere_mesh
from data_tools.embedding.surface_points import spread_points
from data_tools.io.shapes import write_mesh
from data_tools.options import SamplingOptions
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from tests.commands import read_json
from tests.notes import only
from tests.pairwise.test_partial_match import moved

pytestmark = pytest.mark.usefixtures("quick_search")
OPTIONS = AlignOptions(group="SO", sampling=SamplingOptions(num_points=24, num_dense_points=300))
STANDING = ("blob1", "blob4")


def on_stand(shape):
    """Return a shape with a flat stand below, joined by two triangles, and which vertices are its lower half."""
    points, num = shape.vertices, len(shape.vertices)
    lowest, size = int(points[:, 2].argmin()), points.std()
    disk, faces = sphere_mesh(300)
    stand = disk * [1.1 * size, 0.8 * size, 0.35 * size]
    stand += points[lowest] - [0.0, 0.0, 0.4 * size]
    face = shape.faces[(shape.faces == lowest).any(axis=1)][0]
    other = int(face[face != lowest][0])
    one, two = num + np.argsort(np.linalg.norm(stand - points[lowest], axis=1))[:2]
    bridge = [[lowest, other, one], [lowest, one, two]]
    joined = Shape.from_arrays(
        np.concatenate([points, stand]),
        np.concatenate([shape.faces, faces + num, bridge]),
        name=shape.name,
    )
    return joined, np.concatenate([np.zeros(num, dtype=bool), disk[:, 2] < 0.0])


@pytest.fixture(scope="module")
def family():
    rng = np.random.default_rng(5)
    ball = blob(rng, num_vertices=1200)
    long = Shape.from_arrays(ball.vertices * [1.6, 1.0, 0.7], ball.faces, name="blob")
    return deformed_family(long, 6, rng, rms=0.008)


@pytest.fixture(scope="module")
def standing(family, tmp_path_factory):
    """The folder of six blobs in random poses, two of them on stands, with their rotations and stands."""
    rng, folder = np.random.default_rng(6), tmp_path_factory.mktemp("stands")
    turns, stands = {}, {}
    for number, shape in enumerate(family):
        name = f"blob{number}"
        given, low = on_stand(shape) if name in STANDING else (shape, np.zeros(1200, dtype=bool))
        turns[name], stands[name] = random_rotation(rng), low
        write_mesh(
            folder / f"{name}.ply", moved(given, turns[name], rng.uniform(0.5, 2.0), np.ones(3))
        )
    return folder, turns, stands


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return tmp_path_factory.mktemp("store") / "store.sqlite"


def align(folder, store, **options):
    return align_collection(
        folder, options=replace(OPTIONS, **options), jobs=1, store=store, progress=False
    )


@pytest.fixture(scope="module")
def aligned(standing, store):
    return align(standing[0], store)


def test_poses_ignore_a_stand_that_a_note_names(aligned, standing):
    frames = aligned.rotations @ np.stack([standing[1][name] for name in aligned.names])
    assert rotation_angle_deg(frames, frames[0]).max() < 5.0
    note = only(aligned.notes, "extra-material")
    assert note.shapes == STANDING
    assert min(note.values["shares"]) > 0.05
    assert not note.values["ignored"]
    assert "--ignore-extra" in note_text(note)
    for one in aligned.extra:
        turn = frames[one.shape]
        assert one.direction(aligned.transforms[one.shape]) @ turn @ [0.0, 0.0, -1.0] > 0.8


def test_correspondences_hold_whole_surfaces_unless_extra_is_ignored(aligned, standing, store):
    without = align(standing[0], store, ignore_extra=True)
    assert only(without.notes, "extra-material").values["ignored"]
    for collection in (aligned, without):
        assert (np.sort(collection.maps.labels, axis=1) == np.arange(24)).all()
    for collection, is_held in ((aligned, True), (without, False)):
        for name in STANDING:
            samples = collection.samples[collection.index(name)]
            assert standing[2][name][samples].any() == is_held
    assert np.allclose(aligned.transforms, without.transforms)


def test_files_and_page_say_where_extra_material_is(aligned, tmp_path):
    saved = tmp_path / "saved"
    aligned.save(saved)
    entries = read_json(saved / "alignment.json")["extra"]
    assert [one["name"] for one in entries] == list(STANDING)
    loaded = load(saved)
    assert [one.share for one in loaded.extra] == [one["share"] for one in entries]
    assert np.allclose(
        loaded.extra[0].direction(loaded.transforms[1]), entries[0]["direction"], atol=1e-6
    )
    document, blobs = build_content(loaded)
    drawn = document["shapes"][1]["extra"]
    assert drawn["mesh"] in document["meshes"]
    assert f"mesh-{drawn['mesh']}" in blobs
    assert "extra" not in document["shapes"][0]


def test_what_is_elsewhere_on_the_others_is_no_extra_material(family):
    """A limb that points another way is missing where the others have it."""
    surfaces = []
    for number, shape in enumerate(family):
        points = shape.vertices.copy()
        limb = points[:, 2] * (-1.0 if number == 0 else 1.0) > np.quantile(
            np.abs(points[:, 2]), 0.8
        )
        points[limb, 2] *= 2.2
        limbed = Shape.from_arrays(points, shape.faces, name=shape.name)
        surfaces.append(spread_points(limbed, 300))
    assert not extra_points(surfaces[0], surfaces[1:], 1.0).any()


def test_distances_are_those_of_disks_in_tangent_planes():
    x, y = np.mgrid[0:10, 0:10].reshape(2, -1).astype(float)
    points = np.stack([x, y, np.zeros(100)], axis=1)
    normals = np.tile([0.0, 0.0, 1.0], (100, 1))
    places = np.array([[4.5, 4.5, 0.0], [4.2, 4.8, 2.0], [12.0, 5.0, 0.0]])
    assert Disks(points, normals).distances(places).tolist() == pytest.approx([0.0, 2.0, 2.0])
