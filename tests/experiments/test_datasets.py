import numpy as np
import pytest

from experiments import datasets


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
