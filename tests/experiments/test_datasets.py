import numpy as np
import pytest

from data_tools.datasets.synthetic import bumped
from data_tools.datasets.synthetic_shapes import blob
from experiments import datasets


@pytest.fixture
def registered(rng):
    base = blob(rng, num_vertices=80)
    return [bumped(base, rng) for _ in range(3)]


def quaternion_pose(scan, q, t):
    """The vertices in the common frame, by rotating with the conjugate quaternion (independent of any matrix)."""
    axis, w = -q[:3], q[3]
    v = scan.vertices
    return v + 2 * np.cross(axis, np.cross(axis, v) + w * v) + t


@pytest.mark.data
def test_public_collections_agree_with_their_ground_truth(shared_data):
    teeth = datasets.read_teeth(shared_data / "teeth_pnas116")
    ant = datasets.read_shrec07_class(shared_data / "shrec07_dev" / "ant")
    for dataset, count, tolerance in ((teeth, 116, 0.03), (ant, 20, 1e-6)):
        assert len(dataset) == count
        shape = dataset.shape(5)
        gap = shape.vertices[dataset.landmark_vertices[5]] - dataset.landmarks[5]
        assert np.linalg.norm(gap, axis=1).max() < tolerance * np.linalg.norm(
            np.ptp(shape.vertices, axis=0)
        )
    signs = [np.linalg.det(teeth.rotation(0, j, group="O")) for j in range(116)]
    np.testing.assert_array_equal(np.sign(signs), teeth.chirality[0] * teeth.chirality)
