"""What is known of all shapes, of some of them: by their positions among these."""

import numpy as np

from collalign.products.pair import FormerPairs
from collalign.products.shapes import Constraints


def test_constraints_follow_their_shapes():
    turns = {i: np.diag([1.0, -1.0, -1.0]) * (i + 1) for i in (1, 3)}
    some = Constraints(fixed=turns, fixed_transforms={3: np.eye(4)}, reference=3).some([0, 2, 3])
    assert list(some.fixed) == [2]
    np.testing.assert_array_equal(some.fixed[2], turns[3])
    assert list(some.fixed_transforms) == [2]
    assert some.reference == 2
    assert Constraints(reference=1).some([0, 2]).reference == 0


def test_former_pairs_follow_their_shapes():
    former = FormerPairs(num_shapes=4, edges=np.array([[0, 1], [0, 2], [2, 3]]), group="O")
    some = former.some([0, 2, 3, 5])
    assert (some.num_shapes, some.group) == (3, "O")
    assert some.edges.tolist() == [[0, 1], [1, 2]]
    assert former.some([1, 3]).edges.shape == (0, 2)
