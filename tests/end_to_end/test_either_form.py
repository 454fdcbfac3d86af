"""Every tool takes a result in memory as it takes the folder that it was saved to, and finds the same."""

import numpy as np
import pytest

import collalign
from data_tools.datasets.synthetic import write_collection, write_mesh
from data_tools.landmark_files import Landmarks
from tests.finished_runs import chairs

OPTIONS = {"sampling": {"num_points": 16, "num_dense_points": 200}}


@pytest.fixture(scope="module")
def forms(tmp_path_factory):
    """A result just made, the folder it was saved to, and how tools run: equal work is done once."""
    folder = tmp_path_factory.mktemp("forms")
    write_collection(folder / "shapes", chairs(3))
    made = collalign.align_collection(folder / "shapes", options=OPTIONS, jobs=1, progress=False)
    made.save(folder / "out", report=False)
    alone = {"run": {"jobs": 1, "store": folder / "store.sqlite"}, "progress": False}
    return made, folder / "out", alone


def transferred(result, alone):
    shape = collalign.load(result)
    marks = {shape.names[0]: Landmarks(labels=("tip",), points=shape.shape_at(0).vertices[:1])}
    return collalign.landmarks.transfer_landmarks(result, marks, **alone).points


def added(result, alone, folder):
    write_mesh(folder / "late.ply", chairs(4).shapes[3])
    return collalign.add_to_collection(result, [folder / "late.ply"], **alone).transforms


def repeated(result, alone):
    few = {"num_points": (), "num_seeds": 1, "num_subsets": 0}
    return collalign.check_stability(result, options=few, **alone).changes_deg


@pytest.mark.parametrize(
    "found",
    [
        lambda result, alone, _: collalign.maps.dense_correspondence(result, **alone).vertices,
        lambda result, alone, _: transferred(result, alone),
        lambda result, alone, _: repeated(result, alone),
        lambda result, alone, _: collalign.certify_collection(result, **alone).joint.bound,
        lambda result, alone, folder: (
            collalign.statistics.write_surface_variation(result, folder / "to", **alone).mean
        ),
        added,
    ],
    ids=["correspond", "transfer", "stability", "certify", "variation", "add"],
)
def test_a_tool_finds_the_same_of_a_result_in_memory_and_of_its_folder(found, forms, tmp_path):
    made, out, alone = forms
    np.testing.assert_allclose(
        found(made, alone, tmp_path), found(out, alone, tmp_path), rtol=1e-6, atol=1e-9
    )
