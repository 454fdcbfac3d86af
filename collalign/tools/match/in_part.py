"""Two shapes that overlap in part: the best pose of one on the other, its alternatives, and the overlap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np

from collalign.confidence.incomplete_model import PAIR_WEIGHT
from collalign.confidence.overlap_model import (
    MOST_CERTAIN,
    chances_of,
    on_whole_log_odds,
    overlap_log_odds,
)
from collalign.options import TwoShapeKeywords, TwoShapeOptions
from collalign.products.trust import DOUBT
from collalign.tools.match.on_whole import both_scales, is_closed
from data_tools.arrays import FloatArray
from data_tools.checks import as_options
from data_tools.embedding.surface_points import centre_and_radius, spread_points, surface_cells
from data_tools.errors import InputError
from data_tools.io.objects import ShapeLike, as_origin
from data_tools.io.shapes import read_alike
from data_tools.io.source import location
from data_tools.local_surface import PART_CELL, shows_scene
from data_tools.notes import percent
from data_tools.partial_surface import MOST_POINTS
from data_tools.poses import AGREE_DEG, Similarity, pose_angle_deg, scales_of
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread
from pairwise.features.on_whole import free_axis, match_on_whole
from pairwise.features.overlap import LocalPoses, match_overlapping
from pairwise.partial_match import match_partial

#: Poses that a match keeps.
NUM_POSES = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class PartialPose:
    """A pose of a source on a target that it overlaps in part.

    Attributes
    ----------
    pose : Similarity
        Takes the source to the target.
    chance : float
        How probable the pose is; what all leave is that none is right.
    overlap_target, overlap_source : float
        Share of each surface's points with a counterpart on the other.
    """

    pose: Similarity
    chance: float
    overlap_target: float
    overlap_source: float


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PartialMatch:
    """The pose of a source on a target that it overlaps in part.

    Attributes
    ----------
    target_file, source_file : str
        Empty for shapes that came from memory.
    target, source : str
        Their names.
    poses : tuple of PartialPose
        The best one first, in the shapes' own coordinates.
    mirror_chance : float
        How probable a pose of the source's mirror image is, at the sizes of the files; NaN where nobody asked.
    free_axis : ndarray, shape (2, 3), or None
        A point, in coordinates of the target, and the direction of the axis about which the source may be turned as
        you like, such as that of a shaft.
    """

    target_file: str
    source_file: str
    target: str
    source: str
    poses: tuple[PartialPose, ...]
    mirror_chance: float = np.nan
    free_axis: FloatArray | None = None

    @property
    def mirror_fits_better(self) -> bool:
        """Whether its mirror image has more chance than all rotations, and that no pose is right, together.

        Chosen on 16 pairs of a generated surface and a part of it. Where a surface is bilateral, both kinds share.
        """
        return self.mirror_chance > 0.5

    @property
    def transforms(self) -> FloatArray:
        """The answer and its alternatives, shape (m, 4, 4): coordinates of the source to those of the target."""
        return np.stack([found.pose.transform for found in self.poses])

    @property
    def transform(self) -> FloatArray:
        """The answer, shape (4, 4)."""
        return np.asarray(self.transforms[0])

    @property
    def confidence(self) -> float:
        """The chance that the answer is right: that of all poses of its rotation, or turned about a free axis."""
        return _chance_of_first(self.poses, self.free_axis)

    def __repr__(self) -> str:
        best = self.poses[0]
        overlaps = (
            f"{percent(best.overlap_source)} of it on {percent(best.overlap_target)} of the other"
        )
        return f"<PartialMatch: {self.source} on {self.target}, {overlaps}, confidence {percent(self.confidence)}>"

    def record(self) -> dict[str, Any]:
        """Return what ``match.json`` holds."""
        return {
            "target": self.target_file,
            "source": self.source_file,
            "partial": True,
            "confidence": self.confidence,
            "mirror_chance": None if np.isnan(self.mirror_chance) else self.mirror_chance,
            "transform": self.transform.tolist(),
            "scale": float(scales_of(self.transform)),
            "free_axis": None
            if self.free_axis is None
            else {"point": self.free_axis[0].tolist(), "direction": self.free_axis[1].tolist()},
            "candidates": [
                {
                    "transform": transform.tolist(),
                    "chance": found.chance,
                    "reflected": bool(np.linalg.det(found.pose.rotation) < 0),
                    "overlap": {"target": found.overlap_target, "source": found.overlap_source},
                }
                for transform, found in zip(self.transforms, self.poses, strict=True)
            ],
        }


@one_blas_thread()
def match_in_part(
    target: ShapeLike,
    source: ShapeLike,
    *,
    options: TwoShapeOptions | Mapping[str, Any] | None = None,
    **keywords: Unpack[TwoShapeKeywords],
) -> PartialMatch:
    """Match two shapes of which each may lack what the other has.

    Neither centroids nor sizes of different parts say anything. Poses on which neighbourhoods of both surfaces agree
    are found at the sizes of the files first. If none of them is convincing, they are looked for at other sizes as
    well. Sizes stay if ``options.sampling.normalisation`` is "none", as for scans of one object. A scan is placed on
    a closed mesh by all of its points. What the mesh has in front of what the scan saw counts against a pose.

    Parameters
    ----------
    target, source : file, array (n, 3), pair (V, F), or trimesh or Open3D object
    options : TwoShapeOptions or mapping, optional
        Its group, cleaning and ``sampling.normalisation`` count.
    **keywords
        Fields of ``options`` by themselves, which win.

    Raises
    ------
    InputError
        If a shape cannot be read or is too small, or no pose is found at all.

    Examples
    --------
    >>> found = collalign.match_in_part("scan.ply", "piece.ply")
    >>> found.transform.shape, len(found.poses) > 0
    ((4, 4), True)
    """
    options = as_options("options", options, TwoShapeOptions, keywords)
    origins = as_origin(target, "target"), as_origin(source, "source")
    to, of = read_alike(origins, options.cleaning)
    found = _posed(to, of, options.group, known_sizes=options.sampling.normalisation == "none")
    target_file, source_file = (location(origin) for origin in origins)
    return PartialMatch(
        target_file=target_file,
        source_file=source_file,
        target=to.name,
        source=of.name,
        poses=found.poses,
        free_axis=found.free_axis,
    )


@one_blas_thread()
def with_mirror_chance(found: PartialMatch, options: TwoShapeOptions) -> PartialMatch:
    """Return a match of two files with the chance of a pose of the source's mirror image.

    Parameters
    ----------
    found : PartialMatch
        Of files, without mirror images.
    options : TwoShapeOptions
        Of that match.
    """
    to, of = read_alike((Path(found.target_file), Path(found.source_file)), options.cleaning)
    mirrored = (
        one.chance
        for one in _poses_by_neighbourhoods(to, of, "O").poses
        if np.linalg.det(one.pose.rotation) < 0
    )
    return replace(found, mirror_chance=float(sum(mirrored)))


class _Found(NamedTuple):
    """Distinct poses, the most probable first, and the axis (2, 3) about which the source turns freely, if any."""

    poses: tuple[PartialPose, ...]
    free_axis: FloatArray | None = None

    @property
    def confidence(self) -> float:
        """How probable the first pose is; 0 where there is none."""
        return _chance_of_first(self.poses, self.free_axis) if self.poses else 0.0


def _posed(target: Shape, source: Shape, group: str, *, known_sizes: bool) -> _Found:
    """Return poses of a source on a target."""
    found = _poses_by_neighbourhoods(target, source, group)
    if not known_sizes and found.confidence < DOUBT:
        found = _Found(_poses_of_any_size(target, source, group))
    if not found.poses:
        raise InputError(
            f"{source.name} on {target.name}: no pose was found, because no parts of the surfaces match"
        )
    return found


def _chance_of_first(poses: Sequence[PartialPose], free_axis: FloatArray | None) -> float:
    """Return how probable the first pose is: poses of its rotation, or turned about a free axis, together."""
    rotations = np.stack([found.pose.rotation for found in poses])
    chances = np.array([found.chance for found in poses])
    same = pose_angle_deg(rotations, rotations[0]) <= AGREE_DEG
    if free_axis is not None:
        turns = rotations @ rotations[0].T
        kept = (turns @ free_axis[1]) @ free_axis[1] >= np.cos(np.radians(AGREE_DEG))
        same |= kept & (np.linalg.det(turns) > 0)
    return min(float(chances[same].sum()), MOST_CERTAIN)


def _poses_by_neighbourhoods(target: Shape, source: Shape, group: str) -> _Found:
    """Return poses at the sizes of the files.

    Where one shape is closed and the other is not, all of the other one may lie on it. If that is in doubt, it is
    that or what both share: whichever is surer.
    """
    on_whole = _Found(())
    if is_closed(target) != is_closed(source):
        on_whole = _poses_of_part(target, source, group)
    if on_whole.confidence >= DOUBT:
        return on_whole
    shared = _Found(_poses_by_overlap(target, source, group))
    return on_whole if on_whole.confidence > shared.confidence else shared


def _poses_of_part(target: Shape, source: Shape, group: str) -> _Found:
    """Return poses of that shape which is not closed on the one that is."""
    is_source_part = is_closed(target)
    whole, part = (target, source) if is_source_part else (source, target)
    surfaces = both_scales(whole, part)
    if surfaces is None:
        return _Found(())
    side_known = part.is_mesh  # the normals of a cloud may be on either side
    found = match_on_whole(*surfaces, group=group, num_candidates=NUM_POSES, side_known=side_known)
    chances = chances_of(on_whole_log_odds(found))
    order = np.argsort(-chances, kind="stable").tolist()
    best = found.rotations[order[0]], found.shifts[order[0]]
    axis = None
    if np.linalg.det(best[0]) > 0:
        ends = surfaces[0].coarse, surfaces[1].coarse
        axis = free_axis(*ends, *best, side_known=side_known)
    if axis is not None and not is_source_part:
        axis = np.stack([best[0].T @ (axis[0] - best[1]), best[0].T @ axis[1]])
    return _Found(_listed(found if is_source_part else found.inverse(), chances), axis)


def _poses_by_overlap(target: Shape, source: Shape, group: str) -> tuple[PartialPose, ...]:
    """Return poses on which both share much."""
    cell = PART_CELL * float(np.mean([centre_and_radius(shape)[1] for shape in (target, source)]))
    surfaces = [surface_cells(shape, cell) for shape in (target, source)]
    of_scene = shows_scene([surface for surface in surfaces if surface is not None])
    if of_scene:
        surfaces = [surface_cells(shape, cell, of_scene=True) for shape in (target, source)]
    if surfaces[0] is None or surfaces[1] is None:
        return ()
    found = match_overlapping(surfaces[0], surfaces[1], group=group, num_candidates=NUM_POSES)
    return _listed(found, chances_of(overlap_log_odds(found)))


def _listed(found: LocalPoses, chances: FloatArray) -> tuple[PartialPose, ...]:
    """Return poses, the most probable first."""
    return tuple(
        PartialPose(
            pose=Similarity(rotation=found.rotations[p], scale=1.0, shift=found.shifts[p]),
            chance=float(chances[p]),
            overlap_target=float(found.overlaps[p, 0]),
            overlap_source=float(found.overlaps[p, 1]),
        )
        for p in np.argsort(-chances, kind="stable").tolist()
    )


def _poses_of_any_size(target: Shape, source: Shape, group: str) -> tuple[PartialPose, ...]:
    """Return poses on which neighbourhoods agree at some size, compared by closest points."""
    surfaces = [spread_points(shape, MOST_POINTS) for shape in (target, source)]
    searched = match_partial(*surfaces, group=group, num_candidates=NUM_POSES)
    if not searched:
        return ()
    odds = -PAIR_WEIGHT * np.log([found.energy for found in searched])
    shares = np.exp(odds - odds.max())
    return tuple(
        PartialPose(
            pose=found.pose,
            chance=float(share),
            overlap_target=found.overlap_target,
            overlap_source=found.overlap_source,
        )
        for found, share in zip(searched, shares / shares.sum(), strict=True)
    )
