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
from tests.data_tools.surface.test_joined import boxes
from tests.end_to_end.test_reported_inputs import bumpy
from tests.finished_runs import angles_deg
from tests.notes import codes, only


def align(shapes, **options):
    return align_collection(shapes, **{"jobs": 1, "progress": False} | options)


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


def test_exact_copies_of_few_points_are_sure():
    for num in (18, 40, 100):
        rng = np.random.default_rng(num)
        points, turns = rng.random((num, 3)), {name: random_rotation(rng) for name in "abc"}
        found = align({name: points @ turn.T for name, turn in turns.items()})
        assert errors_deg(found, turns).max() < 0.01
        assert (found.confidence >= DOUBT).all()
        assert not {"open-borders", "doubtful"} & {*codes(found.notes)}


def test_copies_of_symmetric_points_are_in_doubt(rng):
    """The corners of a box come back to themselves after half turns."""
    corners = np.array([(x, y, z) for x in (0, 3) for y in (0, 2) for z in (0, 1)], dtype=float)
    found = align(
        {name: corners @ random_rotation(rng).T for name in "abc"}, embedding={"kind": "xyz"}
    )
    assert (found.confidence < DOUBT).all()


def test_objects_of_few_vertices_are_matched_between_these(rng):
    turns, shapes = {name: random_rotation(rng) for name in "abc"}, {}
    for name, turn in turns.items():
        w, d, h = rng.uniform((0.9, 0.5, 0.6), (1.3, 0.7, 0.8))
        desk = boxes(
            ((w, d, 0.05), (0, 0, h)),
            ((0.05, d, h), (-w / 2, 0, h / 2)),
            ((0.05, d, h), (w / 2, 0, h / 2)),
            ((0.4 * w, 0.9 * d, 0.4 * h), (0.25 * w, 0, 0.75 * h)),
            ((w, 0.03, 0.5 * h), (0, d / 2, 0.7 * h)),
        )
        assert len(desk.vertices) == 40
        shapes[name] = (desk.vertices @ turn.T, desk.faces)
    found = align(shapes)
    assert not found.excluded
    assert errors_deg(found, turns).max() < 5.0


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


def test_a_table_larger_than_the_object_is_not_taken_for_it(rng):
    shapes, turns = posed_bumpy(5, rng)
    for name, (points, faces) in shapes.items():
        disc = trimesh.creation.cylinder(radius=4.0, height=0.15, sections=48)
        bar = trimesh.creation.box((1.2, 0.15, 0.05))
        turn, low = random_rotation(rng), points[:, 2].min()
        beside = [
            disc.vertices + np.array([*0.4 * rng.normal(size=2), low - 0.12]),
            bar.vertices + np.array([2.6 * np.cos(low), 2.6 * np.sin(low), low + 0.1]),
        ]
        starts = np.cumsum([len(points), len(disc.vertices)])
        shapes[name] = (
            np.concatenate([points, *beside]) @ turn.T,
            np.concatenate([faces, disc.faces + starts[0], bar.faces + starts[1]]),
        )
        turns[name] = turn @ turns[name]
    found = align(shapes)
    assert only(found.notes, "plain-left-out").shapes == found.names
    assert errors_deg(found, turns).max() < 5.0
    assert (found.confidence >= DOUBT).all()


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
