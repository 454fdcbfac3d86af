"""Collections as people reported them of other programs: members that hold too little, or more than the shape."""

import numpy as np

from collalign import align_collection
from collalign.products.trust import DOUBT
from data_tools.rotations import random_rotation
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


def test_tables_of_few_points_lower_nobody(rng):
    shapes, turns = posed_bumpy(5, rng)
    tables = {f"{name}_table": points[::35][:18] for name, (points, _) in shapes.items()}
    found = align(shapes | tables)
    few = only(found.notes, "few-points")
    assert {*few.shapes} == {*tables}
    assert few.values["counts"] == (18,) * 5
    assert errors_deg(found, turns).max() < 2.0
    of_meshes = [found.confidence[found.names.index(name)] for name in turns]
    assert min(of_meshes) >= DOUBT


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
