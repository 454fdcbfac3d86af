"""Maps that start from rigid poses: they find the pose of a bent figure and know the right start from a wrong one."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.portfolio import (
    at_few_samples,
    posed_candidates,
    refined_with_evidence,
    with_pose_evidence,
)
from collalign.nonrigid.pose_maps import PoseMapper, axis_poses, prepare_posed, sampled_surface
from collalign.nonrigid.spectral_shape import prepare_surface
from data_tools.datasets.synthetic import bent
from data_tools.datasets.synthetic_shapes import figure
from data_tools.errors import InputError
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape


@pytest.fixture(scope="module")
def bent_pair():
    rng = np.random.default_rng(3)
    shape, turn = figure(resolution=3), random_rotation(np.random.default_rng(4))
    other = bent(shape, rng, angle=0.5)
    turned = Shape.from_arrays(other.vertices @ turn.T, other.faces)
    return prepare_posed(shape), prepare_posed(turned), turn.T


def test_a_rough_start_leads_to_the_pose_of_the_map(bent_pair):
    target, source, true = bent_pair
    mapper = PoseMapper(target, source)
    tilt = Rotation.from_euler("x", 0.4).as_matrix()
    found = mapper.rotation_of(mapper.map_from(tilt @ true), chirality=1.0)
    assert rotation_angle_deg(found, true) < 12.0


def test_signs_of_eigenfunctions_find_the_pose_without_one(bent_pair):
    target, source, true = bent_pair
    mapper = PoseMapper(target, source)
    maps = mapper.maps_from_signs()
    judged = [mapper.evidence(one) for one in maps]
    assert max(one.orientation for one in judged) > 0.8
    assert min(one.orientation for one in judged) < 0.3, "signs that do not fit lead to torn maps"
    off = np.array(
        [rotation_angle_deg(mapper.rotation_of(one, chirality=1.0), true) for one in maps]
    )
    scores = np.array([one.score for one in judged])
    assert off[np.argmin(scores)] < 12.0
    assert (off > 150.0).any(), "some of them turn the figure around"
    assert scores[off > 150.0].min() > scores.min() + 1.0


def test_axis_poses_are_the_octahedral_group_and_move_with_the_shapes(bent_pair):
    target, source, _ = bent_pair
    poses = axis_poses(target, source, mirrored=True)
    assert poses.shape == (48, 3, 3)
    assert np.sign(np.linalg.det(poses)).tolist() == [1.0] * 24 + [-1.0] * 24
    back = axis_poses(source, target, mirrored=False)
    nearest = [rotation_angle_deg(np.tile(pose.T, (24, 1, 1)), poses[:24]).min() for pose in back]
    assert max(nearest) < 1e-3


def test_clouds_and_tiny_meshes_are_refused():
    with pytest.raises(InputError, match="need a mesh"):
        prepare_posed(Shape.from_arrays(np.random.default_rng(0).random((300, 3))))
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    with pytest.raises(InputError, match="vertices"):
        prepare_posed(Shape.from_arrays(corners, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))


def test_what_a_pose_leaves_tells_a_torn_map_from_the_right_one():
    rng, options = (
        np.random.default_rng(3),
        SurfaceOptions(num_functions=40, num_samples=60, num_dense=200),
    )
    shape, turn = figure(resolution=2), random_rotation(np.random.default_rng(4))
    other = bent(shape, rng, angle=0.5)
    target = prepare_surface(shape, options)
    source = prepare_surface(Shape.from_arrays(other.vertices @ turn.T, other.faces), options)
    mapper = PoseMapper(sampled_surface(target), sampled_surface(source))
    found = posed_candidates(at_few_samples(mapper), NonrigidOptions())
    assert [one.score for one in found] == sorted(one.score for one in found)
    assert all(one.evidence.orientation > 0 for one in found)
    best = mapper.rotation_of(found[0].functional_map, chirality=1.0)
    assert rotation_angle_deg(best, turn.T) < 15.0
    starts = [mapper.map_from(start @ turn.T) for start in (np.eye(3), np.diag([-1.0, -1.0, 1.0]))]
    judgements = [
        refined_with_evidence(target, source, mapper.oriented(one, preserving=True), "poses")
        for one in starts
    ]
    right, flipped = (
        with_pose_evidence(mapper, one, NonrigidOptions()).evidence for one in judgements
    )
    assert right.normals < flipped.normals
    assert right.surface < flipped.surface
    blind = replace(right, normals=float("nan"), surface=float("nan"))
    assert right.score < blind.score, "small gaps support a map"
    own = replace(found[0], origin="signs")
    assert own.score < found[0].score, "a map that only poses lead to must be better"
