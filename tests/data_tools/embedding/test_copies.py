"""Copies are found in any pose, size, order and precision; other shapes of the same family are none."""

import numpy as np
import pytest

from data_tools.datasets.synthetic import deformed_family
from data_tools.datasets.synthetic_shapes import blob, chair
from data_tools.embedding.copies import find_copies, shape_signature
from data_tools.notes import Note
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape

SHAPE = blob(np.random.default_rng(3), num_vertices=500)


def turned(shape, rng, *, mirrored=False):
    """Return a copy in another pose and size, its vertices in another order."""
    order = rng.permutation(len(shape.vertices))
    vertices = 3.0 * shape.vertices @ random_rotation(rng) * (
        -1.0 if mirrored else 1.0
    ) + rng.standard_normal(3)
    return Shape.from_arrays(vertices[order], np.argsort(order)[shape.faces], name="copy")


def found(*shapes, digests=None):
    names = tuple(f"s{at}" for at in range(len(shapes)))
    signatures = [shape_signature(one) for one in shapes]
    copies = find_copies(
        names, names if digests is None else digests, signatures, [one.notes for one in shapes]
    )
    return [(one.kind, one.names) for one in copies]


@pytest.mark.parametrize(
    "rounded", [lambda points: points, np.float32, lambda points: np.round(points, 5)]
)
def test_a_copy_in_another_pose_is_found_and_a_mirror_image_is_one(rng, rounded):
    copy, image = turned(SHAPE, rng), turned(SHAPE, rng, mirrored=True)
    copy, image = (Shape.from_arrays(rounded(one.vertices), one.faces) for one in (copy, image))
    assert found(SHAPE, copy) == [("moved", ("s0", "s1"))]
    assert found(image, SHAPE) == [("mirrored", ("s0", "s1"))]
    assert found(SHAPE, image, copy) == [("moved", ("s0", "s2")), ("mirrored", ("s0", "s1"))]


def test_specimens_of_one_kind_are_no_copies(rng):
    assert found(*deformed_family(chair(rng, resolution=1), 6, rng, rms=0.005)) == []
    assert found(SHAPE) == []


def test_a_note_names_copies_and_their_kind():
    (one,) = find_copies(
        ("a b", "c", "d e"), ("p", "p", "p"), [shape_signature(SHAPE)] * 3, [()] * 3
    )
    assert one.note == Note("copies", ("a b", "c", "d e"), {"kind": "identical"})
