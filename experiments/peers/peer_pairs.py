"""Other tools' pairs: global registration and refinement as each tool's own documentation has them.

Lengths are in root mean square radii, to which shapes are brought first (:func:`of_one_size`). What a tool is given
beyond its defaults (a voxel size, normals of a mesh instead of estimated ones) was chosen for it: what has the fewest
gross pairs on eight teeth.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from collalign.engine.run_jobs import run_jobs
from collalign.synchronization import synchronize
from data_tools.arrays import FloatArray, IntArray
from data_tools.embedding.sampling import farthest_points
from data_tools.errors import CollectionError
from data_tools.surface.shape import Shape
from experiments.peers.principal_axes import axis_starts, with_short_edges

#: Open3D: points drawn on a mesh, and its voxel.
OPEN3D_POINTS = 10_000
OPEN3D_VOXEL = 0.1
#: KISS-Matcher's voxel.
KISS_VOXEL = 0.07
#: Points for coherent point drift, whose cost grows with their square.
CPD_POINTS = 200
SEED = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedPairs:
    """All pairs of a collection, as a tool matched them.

    Attributes
    ----------
    num_shapes : int
    edges : ndarray of int, shape (E, 2)
        Target and source, in lexicographic order.
    transforms : ndarray, shape (E, 4, 4)
        ``T_target_source``.
    information : tuple of ndarray (6, 6)
        Of each transform, where the tool's own synchronization asks for it.
    """

    num_shapes: int
    edges: IntArray
    transforms: FloatArray
    information: tuple[FloatArray, ...] = ()


def of_one_size(shape: Shape) -> Shape:
    """Return the shape centred, with a root mean square radius of 1."""
    vertices = shape.vertices - shape.vertices.mean(axis=0)
    radius = np.sqrt((vertices**2).sum(axis=1).mean())
    return Shape.from_arrays(vertices / radius, shape.faces, name=shape.name)


def open3d_pairs(shapes: Sequence[Shape], num_jobs: int) -> MatchedPairs:
    """Match by FPFH features and RANSAC, then point-to-plane ICP; Open3D spreads RANSAC over its own threads."""
    import open3d

    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    open3d.utility.random.seed(SEED)
    clouds = [_open3d_cloud(open3d, shape) for shape in shapes]
    edges = list(itertools.combinations(range(len(shapes)), 2))
    transforms, information = [], []
    for target, source in edges:
        transform = _open3d_match(open3d.pipelines.registration, clouds[target], clouds[source])
        transforms.append(transform)
        information.append(
            open3d.pipelines.registration.get_information_matrix_from_point_clouds(
                clouds[source][0], clouds[target][0], 1.5 * OPEN3D_VOXEL, transform
            )
        )
    return _pairs(len(shapes), edges, transforms, tuple(information))


def open3d_pose_graph(pairs: MatchedPairs) -> FloatArray:
    """Optimise a pose graph as Open3D's tutorial on multiway registration does (Choi et al. 2015).

    Poses start from the chain of consecutive shapes, whose edges are certain; all others are loop closures that may
    be pruned.

    Returns
    -------
    ndarray, shape (N, 3, 3)
        ``R_common_shape``.
    """
    import open3d

    registration = open3d.pipelines.registration
    graph = registration.PoseGraph()
    pose = np.eye(4)
    graph.nodes.append(registration.PoseGraphNode(pose))
    for (target, source), transform, information in zip(
        pairs.edges, pairs.transforms, pairs.information, strict=True
    ):
        if source == target + 1:
            pose = pose @ transform
            graph.nodes.append(registration.PoseGraphNode(pose))
        closes_loop = source != target + 1
        edge = registration.PoseGraphEdge(
            source, target, transform, information, uncertain=closes_loop
        )
        graph.edges.append(edge)
    registration.global_optimization(
        graph,
        registration.GlobalOptimizationLevenbergMarquardt(),
        registration.GlobalOptimizationConvergenceCriteria(),
        registration.GlobalOptimizationOption(
            max_correspondence_distance=1.5 * OPEN3D_VOXEL,
            edge_prune_threshold=0.25,
            reference_node=0,
        ),
    )
    return np.stack([np.array(node.pose)[:3, :3] for node in graph.nodes])


def kiss_pairs(shapes: Sequence[Shape], num_jobs: int) -> MatchedPairs:
    """Match by KISS-Matcher, then refine by small_gicp's generalised ICP."""
    import kiss_matcher
    import small_gicp

    clouds = [np.ascontiguousarray(with_short_edges(shape).vertices) for shape in shapes]
    edges = list(itertools.combinations(range(len(shapes)), 2))
    transforms = []
    for target, source in edges:
        matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(KISS_VOXEL))
        found = matcher.estimate(
            clouds[source].astype(np.float32), clouds[target].astype(np.float32)
        )
        start = np.eye(4)
        start[:3, :3], start[:3, 3] = found.rotation, np.ravel(found.translation)
        refined = small_gicp.align(
            clouds[target],
            clouds[source],
            init_T_target_source=start,
            downsampling_resolution=KISS_VOXEL,
            max_correspondence_distance=3 * KISS_VOXEL,
            num_threads=num_jobs,
        )
        transforms.append(np.array(refined.T_target_source))
    return _pairs(len(shapes), edges, transforms)


def drift_pairs(shapes: Sequence[Shape], num_jobs: int) -> MatchedPairs:
    """Match by coherent point drift (rustcpd), from all pairings of the principal axes; the best counts."""
    dense = [with_short_edges(shape) for shape in shapes]
    points = [
        shape.vertices[farthest_points(shape, CPD_POINTS, metric="euclidean")] for shape in dense
    ]
    edges = list(itertools.combinations(range(len(shapes)), 2))
    tasks = [(f"{target} {source}", (points[target], points[source])) for target, source in edges]
    found = {}
    for job in run_jobs(_drift, tasks, num_jobs=num_jobs):
        if job.failure is not None:
            raise CollectionError(f"pair {job.key}: {job.failure}")
        found[job.key] = job.value
    return _pairs(len(shapes), edges, [found[key] for key, _ in tasks])


def spectral(pairs: MatchedPairs) -> FloatArray:
    """Return the plain spectral synchronization of the pairs, ``R_common_shape``, shape (N, 3, 3)."""
    rotations = pairs.transforms[:, :3, :3]
    found = synchronize(pairs.edges, rotations, method="spectral", num_shapes=pairs.num_shapes)
    return np.asarray(found.rotations)


def _open3d_cloud(open3d: Any, shape: Shape) -> tuple[Any, Any]:
    """Return points thinned to voxels with the mesh's normals, or else estimated ones, and their features."""
    vertices = open3d.utility.Vector3dVector(np.array(shape.vertices))
    if shape.is_mesh:
        mesh = open3d.geometry.TriangleMesh(
            vertices, open3d.utility.Vector3iVector(shape.faces.astype(np.int32))
        )
        cloud = mesh.sample_points_uniformly(
            OPEN3D_POINTS, use_triangle_normal=True
        ).voxel_down_sample(OPEN3D_VOXEL)
    else:
        cloud = open3d.geometry.PointCloud(vertices).voxel_down_sample(OPEN3D_VOXEL)
        cloud.estimate_normals(
            open3d.geometry.KDTreeSearchParamHybrid(radius=2 * OPEN3D_VOXEL, max_nn=30)
        )
    nearby = open3d.geometry.KDTreeSearchParamHybrid(radius=5 * OPEN3D_VOXEL, max_nn=100)
    return cloud, open3d.pipelines.registration.compute_fpfh_feature(cloud, nearby)


def _open3d_match(
    registration: Any, target: tuple[Any, Any], source: tuple[Any, Any]
) -> FloatArray:
    reach = 1.5 * OPEN3D_VOXEL
    coarse = registration.registration_ransac_based_on_feature_matching(
        source[0],
        target[0],
        source[1],
        target[1],
        True,
        reach,
        registration.TransformationEstimationPointToPoint(False),
        3,
        [
            registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
            registration.CorrespondenceCheckerBasedOnDistance(reach),
        ],
        registration.RANSACConvergenceCriteria(100_000, 0.999),
    )
    plane = registration.TransformationEstimationPointToPlane()
    fine = registration.registration_icp(source[0], target[0], reach, coarse.transformation, plane)
    return np.array(fine.transformation)


def _drift(clouds: tuple[FloatArray, FloatArray]) -> FloatArray:
    import rustcpd

    centres = [cloud.mean(axis=0) for cloud in clouds]
    target, source = (cloud - centre for cloud, centre in zip(clouds, centres, strict=True))
    best, least = np.eye(4), np.inf
    for start in axis_starts(target, source):
        rotated = np.ascontiguousarray(source @ start.T)
        drift = rustcpd.register_rigid(target, rotated, scale=False, parallel=False)
        if drift.objective < least:
            least = drift.objective
            best = np.eye(4)  # the library multiplies rows from the right
            best[:3, :3], best[:3, 3] = (
                np.asarray(drift.rotation).T @ start,
                np.asarray(drift.translation),
            )
    best[:3, 3] += centres[0] - best[:3, :3] @ centres[1]
    return best


def _pairs(
    num_shapes: int,
    edges: Sequence[tuple[int, int]],
    transforms: Sequence[FloatArray],
    information: tuple[FloatArray, ...] = (),
) -> MatchedPairs:
    return MatchedPairs(
        num_shapes=num_shapes,
        edges=np.array(edges),
        transforms=np.stack(transforms),
        information=information,
    )
