import json

import numpy as np
import pytest

from data_tools.datasets.synthetic import (
    deformed_family,
    demo_collection,
    planted_collection,
    write_collection,
)
from data_tools.datasets.synthetic_shapes import chair
from data_tools.errors import InputError
from data_tools.io.listing import read_folder
from data_tools.io.shapes import read_shape
from data_tools.rotations import rotation_angle_deg


@pytest.mark.parametrize("group", ["SO", "O"])
def test_collection_truth_undoes_the_poses(rng, group):
    family = deformed_family(chair(), 5, rng)
    collection = planted_collection(family, rng, group=group, scale_range=(0.5, 2.0))
    assert [s.name for s in collection.shapes] == ["chair1", "chair2", "chair3", "chair4", "chair5"]
    for i, (shape, member) in enumerate(zip(collection.shapes, family, strict=True)):
        common = (
            (shape.vertices - collection.translations[i])
            / collection.scales[i]
            @ collection.rotations[i].T
        )
        np.testing.assert_allclose(common, member.vertices[collection.origins[i]], atol=1e-9)
        assert np.linalg.det(shape.vertices[shape.faces] - shape.vertices.mean(axis=0)).sum() > 0
    if group == "SO":
        assert not any(collection.reflected)


def test_repeated_names_are_refused(rng):
    with pytest.raises(InputError, match="names repeat"):
        planted_collection((chair(), chair()), rng)


def test_demo_collection_is_written_with_its_truth_and_reads_back(tmp_path):
    collection = demo_collection(num=4, resolution=1)
    files = write_collection(tmp_path, collection)
    listing = read_folder(tmp_path)
    assert listing.files == files
    assert [p.name for p in listing.skipped] == ["truth.json"]
    records = json.loads((tmp_path / "truth.json").read_text())["shapes"]
    for i, record in enumerate(records):
        back = read_shape(tmp_path / record["file"])
        np.testing.assert_allclose(
            back.vertices, collection.shapes[i].vertices, rtol=1e-5, atol=1e-6
        )
        assert rotation_angle_deg(np.array(record["rotation"]), collection.rotations[i]) < 1e-9
        assert record["reflected"] is False
