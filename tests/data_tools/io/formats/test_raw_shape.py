import numpy as np

from data_tools.io.formats.raw_shape import (
    NOT_KEPT,
    content_not_kept,
    fan_triangles,
    not_kept,
)
from data_tools.notes import Note


def test_polygons_are_split_at_their_first_corner():
    corners, sizes = np.array([5, 6, 7, 8, 1, 2, 3, 4, 9, 0]), np.array([4, 3, 2, 1])
    assert fan_triangles(corners, sizes).tolist() == [[5, 6, 7], [5, 7, 8], [1, 2, 3]]
    assert fan_triangles(np.empty(0, dtype=int), np.empty(0, dtype=int)).shape == (0, 3)


def test_what_is_not_kept_is_said_once():
    note = not_kept(["textures", "colours", "colours"])
    assert note == (Note(NOT_KEPT, values={"things": ("colours", "textures")}),)
    assert not_kept([]) == ()
    merged = Note("duplicates-merged", values={"num": 3})
    (of_all,) = content_not_kept({"a": (merged, *note), "b": not_kept(["colours"]), "c": ()})
    assert (of_all.shapes, of_all.values) == (
        ("a", "b"),
        {"things": ("colours", "textures"), "total": 3},
    )
    assert content_not_kept({"a": (merged,)}) == ()
