"""Collections as people reported them of other programs: members that hold too little, or more than the shape."""

import numpy as np
import trimesh

from collalign import align_collection, load
from collalign.products.trust import DOUBT
from collalign.tools.match.rigid import match_rigid
from data_tools.io.shapes import write_mesh
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from tests.commands import run_command
from tests.data_tools.surface.test_hidden import hollow
from tests.end_to_end.test_reported_inputs import bumpy
from tests.finished_runs import angles_deg
from tests.notes import codes, only


def align(shapes, **options):
    few = {"num_points": 40, "num_dense_points": 200}
    return align_collection(shapes, **{"jobs": 1, "progress": False, "sampling": few} | options)


def posed_bumpy(num, rng, subdivisions=3):
    """Return surfaces of a family in random poses, by name, and the rotations to these."""
    turns = {f"s{number}": random_rotation(rng) for number in range(num)}
    shapes = {}
    for number, (name, turn) in enumerate(turns.items()):
        points, faces = bumpy(number, subdivisions)
        shapes[name] = (points @ turn.T, faces)
    return shapes, turns


def errors_deg(found, turns):
    """Return the median angle of the relative rotations of each shape to the right ones."""
    rights = [found.rotations[found.names.index(name)] @ turn for name, turn in turns.items()]
    return np.median(angles_deg(np.array(rights)), axis=1)


def test_a_second_wall_in_some_files_is_left_out(rng):
    shapes, turns = posed_bumpy(6, rng)
    for at, (name, (points, faces)) in enumerate(shapes.items()):
        if at % 2:
            opening = 0.3 if at == 1 else 0.0
            double = hollow(Shape.from_arrays(points, faces), opening, 0.08)
            shapes[name] = (double.vertices, double.faces)
    found = align(shapes)
    assert only(found.notes, "walls-left-out").shapes == ("s1", "s3", "s5")
    assert errors_deg(found, turns).max() < 2.0
    assert (found.confidence >= DOUBT).all()
    assert found.group == "SO"
    assert not found.reflected.any()
    assert found.options.cleaning.inner == "drop"


def test_two_shapes_match_though_one_has_a_second_wall(tmp_path, rng):
    (points, faces), turn = bumpy(0, 3), random_rotation(rng)
    single = Shape.from_arrays(points, faces)
    double = hollow(single, 0.3, 0.08)
    files = [tmp_path / "single.ply", tmp_path / "double.ply"]
    write_mesh(files[0], single)
    write_mesh(files[1], Shape.from_arrays(double.vertices @ turn.T, double.faces))
    found = match_rigid(*files)
    assert "inner-walls-dropped" in codes(found.source.notes)
    back = found.transform[:3, :3] @ turn
    assert angles_deg(np.stack([back / np.cbrt(np.linalg.det(back)), np.eye(3)])).max() < 1.0


def test_an_object_beside_a_larger_piece_is_the_one_that_the_others_show(tmp_path, rng):
    folder, (shapes, turns) = tmp_path / "shapes", posed_bumpy(5, rng)
    bar = trimesh.creation.icosphere(subdivisions=3)
    bent = bar.vertices * [4.0, 0.9, 0.8]
    bent[:, 2] += 0.1 * bent[:, 0] ** 2
    for name in ("s1", "s3"):
        (points, faces), turn = shapes[name], random_rotation(rng)
        beside = np.concatenate([points, bent + np.array([0.0, 6.0, 0.0])])
        shapes[name] = (beside @ turn.T, np.concatenate([faces, bar.faces + len(points)]))
        turns[name] = turn @ turns[name]
    for name, (points, faces) in shapes.items():
        write_mesh(folder / f"{name}.ply", Shape.from_arrays(points, faces))
    found = align(folder)
    assert only(found.notes, "shared-pieces").shapes == ("s1", "s3")
    assert errors_deg(found, turns).max() < 2.0
    assert (found.confidence >= DOUBT).all()
    found.save(tmp_path / "out", report=False)
    assert load(tmp_path / "out").options == found.options
    said = run_command("align", folder, "--check", "--jobs", "1").out
    assert "as the other files show it, beside pieces as large or larger: s1" in said
