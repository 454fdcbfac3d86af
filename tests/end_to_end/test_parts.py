"""Several meshes of one specimen move as one: read together, sampled by area, written one by one."""

import numpy as np
import pytest

from collalign import add_to_collection, load
from collalign.tools.correspond import DenseCorrespondence
from collalign.tools.variation.posture import parts_of_mean
from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import InputError
from data_tools.io.listing import hash_shape, parts_of
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.poses import moved_by
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from tests.commands import read_json, run_command
from tests.finished_runs import angles_deg

NUM = 4
FLAGS = ["--sampling.num-points", "32", "--sampling.num-dense-points", "60", "--jobs", "1"]
FLAGS += ["--maps", "never", "--no-report"]


@pytest.fixture(scope="module")
def poses():
    rng = np.random.default_rng(3)
    return [random_rotation(rng) for _ in range(NUM)]


@pytest.fixture(scope="module")
def folder(poses, tmp_path_factory):
    """A cranium and a mandible of four specimens: of two in a folder each, of two side by side."""
    rng = np.random.default_rng(0)
    skull, jaw = (blob(rng, num_vertices=800) for _ in range(2))
    path = tmp_path_factory.mktemp("skulls")
    for number, pose in enumerate(poses):
        parts = {"cranium": skull.vertices, "mandible": 0.4 * jaw.vertices + [1.5, 0.0, -1.0]}
        for part, vertices in parts.items():
            moved = (
                vertices + 0.01 * rng.standard_normal(vertices.shape)
            ) @ pose  # R_common_shape is the pose
            name = f"s{number}/{part}.ply" if number < 2 else f"s{number}.{part}.stl"
            (path / name).parent.mkdir(exist_ok=True)
            write_mesh(
                path / name,
                Shape.from_arrays(moved, skull.faces if part == "cranium" else jaw.faces),
            )
    return path


@pytest.fixture(scope="module")
def out(folder, tmp_path_factory):
    to = tmp_path_factory.mktemp("results") / "out"
    run_command("align", folder, "--parts", "--out", to, *FLAGS)
    return to


def test_one_pose_a_specimen_and_every_part_is_written_there(folder, out, poses):
    collection = load(out)
    assert collection.names == ("s0", "s1", "s2", "s3")
    assert angles_deg(collection.rotations @ np.swapaxes(poses, 1, 2))[0].max() < 6
    for name, transform in zip(collection.names, collection.transforms, strict=True):
        whole = read_shape(out / "meshes" / f"{name}.ply")
        parts = {
            part: read_shape(out / "meshes" / name / f"{part}.ply")
            for part in ("cranium", "mandible")
        }
        for part, file in parts_of(folder / f"{name}.*").items():
            expected = read_shape(file).transformed(transform)
            np.testing.assert_allclose(parts[part].area, expected.area, rtol=1e-4)
            np.testing.assert_allclose(
                parts[part].vertices.mean(0), expected.vertices.mean(0), atol=1e-4
            )
        assert whole.area < sum(
            part.area for part in parts.values()
        )  # read as usual, its largest part alone
    run_command("export", out, "--format", "stl", "--to", out.with_name("stl"))
    exported = read_shape(out.with_name("stl") / "s2" / "mandible.stl")
    np.testing.assert_allclose(
        exported.area, read_shape(out / "meshes" / "s2" / "mandible.ply").area, rtol=1e-4
    )
    record = read_json(out / "alignment.json")
    assert [shape["file"] for shape in record["shapes"]] == ["s0.*", "s1.*", "s2.*", "s3.*"]
    assert record["shape_notes"]["s0"][0]["values"] == {"parts": ["cranium", "mandible"]}


def test_vertices_of_the_mean_are_told_apart_by_part(out):
    collection = load(out)
    copies = [read_shape(collection.file(at)) for at in range(2)]
    dense = DenseCorrespondence(
        names=collection.names[:2],
        faces=copies[0].faces,
        mean=copies[0].vertices,
        vertices=np.stack(
            [
                moved_by(T, one.vertices)
                for T, one in zip(collection.transforms, copies, strict=False)
            ]
        ),
        completed=np.empty(0),
        residual=np.empty(0),
        quality=np.empty(0),
    )
    names, parts = parts_of_mean(collection, dense)
    assert names == ("cranium", "mandible")
    np.testing.assert_array_equal(parts, np.repeat([0, 1], [size for _, size in copies[0].parts]))


def test_shapes_are_added_and_a_part_that_changes_is_noticed(folder, out, tmp_path, poses):
    new = tmp_path / "new" / "late"
    new.mkdir(parents=True)
    for part, file in parts_of(folder / "s2.*").items():
        write_mesh(new / f"{part}.ply", read_shape(file))
    grown = add_to_collection(out, tmp_path / "new", parts=True, progress=False, run={"jobs": 1})
    assert rotation_angle_deg(grown.rotations[4], load(out).rotations[2]) < 2
    before = hash_shape(new.with_name("late.*"))
    read_shape(new.with_name("late.*"), digest=before)
    write_mesh(new / "mandible.ply", read_shape(folder / "s0" / "mandible.ply"))
    assert hash_shape(new.with_name("late.*")) != before
    with pytest.raises(InputError, match=r"late\.\*: has changed since"):
        read_shape(new.with_name("late.*"), digest=before)
    write_mesh(tmp_path / "new" / "late.mandible.ply", read_shape(folder / "s0" / "mandible.ply"))
    with pytest.raises(InputError, match="two parts have the same name"):
        parts_of(new.with_name("late.*"))
    with pytest.raises(InputError, match="no files of its parts"):
        parts_of(tmp_path / "none.*")
