"""Maps that start from poses, or from signs of eigenfunctions: then a few steps of ZoomOut on few samples.

A non-rigid match searches for the map from inside the surfaces alone and takes seconds; from a pose it takes
milliseconds. The map then says where the pose should be (the rotation that Procrustes takes from it) and whether the
pose was a good idea (the evidence of :mod:`collalign.nonrigid.map_evidence`): a pose that puts the back on the front
leads to a map that is torn, or that does not keep left and right. Where a limb is where another shape has its other
one, closest points exchange them at every pose; there the signs of the lowest eigenfunctions start from within.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from collalign.confidence.map_model import Evidence
from collalign.nonrigid.functional_map import FunctionalMap, mutual_nearest_rows
from collalign.nonrigid.map_evidence import measure_evidence
from collalign.nonrigid.posed_surface import PosedSurface
from collalign.nonrigid.refine import Refiner, unit_rows
from data_tools.arrays import FloatArray, IntArray
from data_tools.rotations import nearest_orthogonal

#: Functions, the constant one included, that ZoomOut starts with, and how fast their number grows.
FIRST_SIZE, GROWTH = 10, 1.5
#: Weights of unit normals, and of the descriptors, each kind of unit variance, beside positions of root mean square
#: radius 1, in the closest points of a start. With descriptors of intrinsic place limbs find each other whatever they
#: do: on 30 pairs of SHREC07's armadillos the pose judged best is 11 instead of 17 deg off in the median.
START_NORMAL_WEIGHT, START_DESCRIPTOR_WEIGHT = 0.3, 0.6
#: Weight of unit normals beside positions of root mean square radius 1 where surfaces are compared.
SURFACE_NORMAL_WEIGHT = 0.5
#: Lowest functions whose signs are enumerated, and how many of the maps that they give are refined: 50 ms a pair. Two
#: of 20 of SHREC07's armadillos, whose other candidates all exchange two limbs, come right by them (``python -m
#: experiments bending``).
NUM_SIGNS, NUM_SIGN_MAPS = 6, 24


def axis_poses(target: PosedSurface, source: PosedSurface, *, mirrored: bool) -> FloatArray:
    """Return the rotations that bring the source's principal axes onto the target's in every order, shape (m, 3, 3).

    24 rotations, and with ``mirrored`` 24 reflections as well: crude poses, but evenly spread, and the same for
    shapes in any pose.
    """
    rotations = Rotation.create_group("O").as_matrix()
    if mirrored:
        rotations = np.concatenate([rotations, -rotations])
    return np.asarray(_principal_axes(target.points) @ rotations @ _principal_axes(source.points).T)


def _principal_axes(points: FloatArray) -> FloatArray:
    axes = np.linalg.svd(points, full_matrices=False)[2].T.copy()
    axes[:, 2] *= np.linalg.det(axes)
    return axes


class PoseMapper:
    """Maps between two surfaces from any number of poses."""

    def __init__(self, target: PosedSurface, source: PosedSurface) -> None:
        self.target, self.source = target, source
        self._refiner = Refiner(target.spectral, source.spectral, first=FIRST_SIZE, factor=GROWTH)
        self._features = _start_features(target, np.eye(3))

    def map_from(self, R_target_source: FloatArray) -> FunctionalMap:
        """Return the map that closest points at a pose (3, 3), of either determinant, lead to."""
        return self._refiner.zoomout.refine(*self.closest_points(R_target_source))

    def closest_points(self, R_target_source: FloatArray) -> tuple[IntArray, IntArray]:
        """Return the maps of the samples, (k,) and (n,), by closest points at a pose (3, 3)."""
        return mutual_nearest_rows(self._features, _start_features(self.source, R_target_source))

    def maps_from_signs(self, num: int = NUM_SIGN_MAPS) -> list[FunctionalMap]:
        """Return the maps that signs of the lowest eigenfunctions lead to, those that fit best at the start.

        Eigenfunctions of near-isometric surfaces agree up to sign where their eigenvalues are simple; the descriptors
        beside them steady those that are not. No pose takes part.
        """
        target, source = (
            np.hstack([unit_rows(one.spectral.functions[:, :NUM_SIGNS]), START_DESCRIPTOR_WEIGHT * one.descriptors])
            for one in (self.target, self.source)
        )
        unsigned, starts = cdist(target, source, "sqeuclidean"), []
        for flips in product((0.0, 4.0), repeat=NUM_SIGNS):  # |t + s|^2 = |t - s|^2 + 4 t s
            gaps = unsigned + (target[:, :NUM_SIGNS] * flips) @ source[:, :NUM_SIGNS].T
            loss = gaps.min(axis=0).mean() + gaps.min(axis=1).mean()
            starts.append((loss, gaps.argmin(axis=0), gaps.argmin(axis=1)))
        best = sorted(range(len(starts)), key=lambda i: starts[i][0])[:num]
        return [self._refiner.zoomout.refine(*starts[i][1:]) for i in best]

    def oriented(self, found: FunctionalMap, *, preserving: bool) -> FunctionalMap:
        """Return the map that keeps the orientation of the surfaces, or reverses it, which a map leads to."""
        return self._refiner.oriented(found.C_source_target, preserving=preserving)

    def evidence(self, found: FunctionalMap) -> Evidence:
        """Return the evidence for a map."""
        return measure_evidence(self.target.spectral, self.source.spectral, found)

    def surface_gap(self, R_target_source: FloatArray) -> float:
        """Return the mean squared distance of closest points and normals at a pose (3, 3), both ways."""
        rotation, source = R_target_source.T, self.source
        fixed = np.hstack([self.target.points, SURFACE_NORMAL_WEIGHT * self.target.normals])
        moved = np.hstack([source.points @ rotation, SURFACE_NORMAL_WEIGHT * source.normals @ rotation])
        there, back = mutual_nearest_rows(fixed, moved)
        gaps = np.concatenate([fixed[there] - moved, fixed - moved[back]])
        return float((gaps**2).sum(axis=1).mean())

    def rotation_of(self, found: FunctionalMap, *, chirality: float) -> FloatArray:
        """Return the orthogonal matrix (3, 3) of determinant ``chirality`` that fits a map and its inverse best."""
        to = np.vstack([self.target.points[found.map_target_source], self.target.points])
        of = np.vstack([self.source.points, self.source.points[found.map_source_target]])
        return nearest_orthogonal((to - to.mean(axis=0)).T @ (of - of.mean(axis=0)), determinant=chirality)

    def normal_gap(self, found: FunctionalMap, R_target_source: FloatArray) -> float:
        """Return the mean of 1 - cosine of the normals that a map and its inverse match, at a pose (3, 3)."""
        forward, backward = found.map_target_source, found.map_source_target
        target, source = self.target.normals, self.source.normals @ R_target_source.T
        cosines = np.concatenate([target[forward] * source, target * source[backward]]).sum(axis=1)
        return float(1.0 - cosines.mean())


def _start_features(surface: PosedSurface, rotation: FloatArray) -> FloatArray:
    """Return what closest points compare at the start, shape (n, 6 + m)."""
    normals = START_NORMAL_WEIGHT * surface.normals @ rotation.T
    return np.hstack([surface.points @ rotation.T, normals, START_DESCRIPTOR_WEIGHT * surface.descriptors])
