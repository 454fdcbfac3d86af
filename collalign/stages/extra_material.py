"""Extra material of shapes, such as a stand: which points it has, and what a result says of it.

It is surface far from that of the other shapes, which lack little on the rest. Centroid, size and invariants would be
off by it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import scipy

from collalign.engine.job import Shared, table_of_values
from collalign.options import AlignSession
from collalign.products.pair import AlignedPair
from collalign.products.shapes import ExtraMaterial, Shapes
from collalign.stages.incomplete.add import label_map
from collalign.stages.incomplete.detect import (
    GRID_GROWTH,
    MIN_COMPLETE_SHAPES,
    NUM_PARTNERS,
    NUM_POINTS,
    posed_samples,
    refined_on,
)
from collalign.stages.incomplete.place import nearest_labels
from collalign.stages.poses.agreement import with_common_match
from collalign.stages.poses.placement import (
    common_positions,
    in_label_order,
    labels_at_common_poses,
)
from collalign.stages.steps import Matched, Posed, Run
from collalign.whole_pairs.problem import match_at_rotation
from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only
from data_tools.embedding.embedding import Samples
from data_tools.notes import Note
from data_tools.partial_surface import PartialSurface
from data_tools.surface.extra import ExtraSurface
from data_tools.surface.topology import vertex_components


@dataclass(frozen=True, kw_only=True, eq=False)
class Extra:
    """Extra material of shapes, by name."""

    surfaces: Mapping[str, ExtraSurface] = field(default_factory=dict)

    def is_same(self, other: Extra) -> bool:
        """Return whether the same surface is extra."""
        return self.surfaces.keys() == other.surfaces.keys() and all(
            (one.is_extra & other.surfaces[name].is_extra).sum()
            >= TUNED.same_share * (one.is_extra | other.surfaces[name].is_extra).sum()
            for name, one in self.surfaces.items()
        )

    def lacks_some_of(self, other: Extra) -> bool:
        """Return whether a shape has extra material in the other and none in this."""
        return bool(other.surfaces.keys() - self.surfaces.keys())


def extra_material(answer: tuple[Run, Matched, Posed], whole: Shapes, before: Extra) -> Extra:
    """Return the extra material of whole shapes at the poses of an answer; none where most of these are in doubt.

    Parameters
    ----------
    answer : (Run, Matched, Posed)
    whole : Shapes
    before : Extra
        What the shapes were posed without.
    """
    run, _, posed = answer
    if np.median(posed.solution.confidence) <= TUNED.doubtful:
        return Extra()
    lacking = {one.shape for one in posed.incomplete}
    part = [i for i in max(posed.solution.parts, key=len).tolist() if i not in lacking]
    most_lacking = TUNED.lacking if before.surfaces else TUNED.lacking_at_first
    with run.stage("extra material"):
        found = find_extra(run.session, whole.samples, posed.transforms, part, most_lacking)
    return Extra(surfaces={whole.names[i]: surface for i, surface in found.items()})


def with_extra_material(
    answer: tuple[Run, Matched, Posed], whole: Run, extra: Extra
) -> tuple[Run, Matched, Posed]:
    """Return poses without extra material with what it is; the samples are of whole surfaces unless it is ignored.

    Parameters
    ----------
    answer : (Run, Matched, Posed)
    whole : Run
        With the shapes as they are.
    extra : Extra
    """
    if not extra.surfaces:
        return answer
    cut, matched, posed = answer
    names, ignored = whole.shapes.names, whole.session.options.ignore_extra
    if not ignored:
        cut, posed = whole, _with_whole_samples(posed, whole.shapes, extra)
    of_shapes = tuple(
        ExtraMaterial(shape=i, surface=extra.surfaces[name])
        for i, name in enumerate(names)
        if name in extra.surfaces
    )
    note = Note(
        "extra-material",
        tuple(names[one.shape] for one in of_shapes),
        {
            "shares": tuple(one.share for one in of_shapes),
            "sides": tuple(one.side(posed.transforms[one.shape]) for one in of_shapes),
            "ignored": ignored,
        },
    )
    return cut, matched, replace(posed, extra=of_shapes, notes=(*posed.notes, note))


def _with_whole_samples(posed: Posed, whole: Shapes, extra: Extra) -> Posed:
    """Return poses that stay, with maps and labels of the samples of whole surfaces."""
    samples, rotations = whole.samples, posed.rotations
    changed = {i for i, name in enumerate(whole.names) if name in extra.surfaces}

    def of_whole(pair: AlignedPair) -> AlignedPair:
        if not {pair.target, pair.source} & changed:
            return pair
        ends = samples[pair.target], samples[pair.source]
        maps = [match_at_rotation(*ends, pose[:3, :3])[0] for pose in pair.rotations]
        return replace(pair, maps=read_only(np.stack(maps)))

    num = len(posed.solution.edge_choice)
    pairs = with_common_match(
        samples, [of_whole(pair) for pair in posed.pairs[:num]], posed.solution, rotations
    )
    lacking = {one.shape for one in posed.incomplete}
    kept = np.array([i for i in range(len(samples)) if i not in lacking])
    at = {int(i): n for n, i in enumerate(kept)}
    positions, labels = common_positions(samples, posed.transforms), posed.labels.copy()
    labels[kept] = labels_at_common_poses(
        [samples[i] for i in kept],
        [replace(pair, target=at[pair.target], source=at[pair.source]) for pair in pairs],
        rotations[kept],
    )
    consensus = in_label_order(positions[kept], labels[kept]).mean(axis=0)
    for i in sorted(lacking):
        labels[i] = nearest_labels(positions[i], consensus)
    of_lacking = [
        replace(
            pair,
            map_target_source=read_only(label_map(labels[pair.target], labels[pair.source])),
        )
        for pair in posed.pairs[num:]
    ]
    return replace(posed, pairs=[*pairs, *of_lacking], labels=labels, consensus=consensus)


class ExtraTuning(NamedTuple):
    """Numbers by which extra material is found.

    Chosen on blobs, skulls and guns on stands of .3 to .8 of their size, and on guitars, guns, teeth, skulls, chairs,
    teddies, spiders and humans without.
    """

    doubtful: float = 0.5
    """Poses tell what is extra if the median shape's confidence is above this, the most of a pose in doubt; symmetric
    shapes may lie anywhere."""
    most_partners: int = 12
    """Shapes that each is compared with; it is refined on about half of them."""
    far_ratio: float = 5.0
    """Extra is what lies so many times as far from the others as the shape's median point, ..."""
    least_far: float = 0.12
    """... and so many of their radii."""
    grown: float = 0.5
    """Around it counts what is so many times as far."""
    least_share: float = 0.02
    """The least share of a surface that is looked at."""
    lacking_at_first: float = 0.75
    """The others lack less of their surface on the shape than so many times what is extra, at first poses, which
    extra material has spoilt (stands have .2 to .75 there), ..."""
    lacking: float = 0.5
    """... and at those without it: stands have .03 to .44 there, what differs on healthy guitars, teeth and humans
    .68 to 7."""
    same_share: float = 0.8
    """It is the same as before if so much of what was found in either round was found in both."""
    num_nearest: int = 8
    """Nearest points of another surface whose tangent planes tell how far a point is from it, and points of one
    surface that each is connected with: meshes of objects have vertices at uneven distances."""


#: The numbers in use.
TUNED = ExtraTuning()


def find_extra(
    session: AlignSession,
    samples: Sequence[Samples],
    transforms: FloatArray,
    part: Sequence[int],
    most_lacking: float,
) -> dict[int, ExtraSurface]:
    """Return the extra material of shapes (by position) at their transforms (N, 4, 4).

    Parameters
    ----------
    session : Session
    samples : sequence of Samples
        Of the shapes with all that their files hold.
    transforms : ndarray, shape (N, 4, 4)
        File coordinates to the common frame.
    part : sequence of int
        Complete shapes that are posed together; the others are not looked at. Too few tell nothing.
    most_lacking : float
        What the others lack at most, as a share of what is extra.
    """
    dense = [i for i in part if len(samples[i].dense_positions) >= NUM_POINTS]
    if len(dense) < MIN_COMPLETE_SHAPES:
        return {}
    points = [posed_samples(samples[i], transforms[i]) for i in dense]
    surfaces = [
        Shared(key=str(n), reader=PartialSurface, growth=GRID_GROWTH) for n in range(len(dense))
    ]
    tasks = {}
    for n, i in enumerate(dense):
        others = [*surfaces[n + 1 :], *surfaces[:n]]
        step = -(-len(others) // TUNED.most_partners)
        tasks[i] = {
            "surface": surfaces[n],
            "partners": tuple(others[::step]),
            "most_lacking": most_lacking,
        }
    with table_of_values(points) as table:
        found = session.map_parallel("extra material", extra_points, tasks, shared=table)
    return {
        i: ExtraSurface(
            points=read_only(samples[i].dense_positions * samples[i].scale + samples[i].offset),
            is_extra=read_only(is_extra),
        )
        for i, is_extra in found.items()
        if is_extra.any()
    }


def extra_points(
    surface: PartialSurface, partners: Sequence[PartialSurface], most_lacking: float
) -> BoolArray:
    """Return which points of a surface are extra, shape (l,), mostly none; runs inside a worker.

    What is extra lies far from most partners, and they have less that lies so far from the surface: a limb that is
    elsewhere is missing where the others have it.
    """
    step = -(-len(partners) // NUM_PARTNERS)
    every = [Disks(one.points, one.normals) for one in partners]
    least_far = TUNED.least_far * float(np.median([one.radius for one in partners]))
    gaps = np.median([one.distances(surface.points) for one in every[::step]], axis=0)
    if (gaps >= TUNED.grown * least_far).mean() < TUNED.least_share:
        return np.zeros(len(gaps), dtype=np.bool_)  # refined, still fewer would be far
    pose = refined_on(partners[::step], surface)
    own = Disks(pose.apply(surface.points)[0], surface.normals @ pose.rotation[0].T)
    gaps = np.median([one.distances(own.points) for one in every], axis=0)
    far = max(TUNED.far_ratio * float(np.median(gaps)), least_far)
    extra = _largest_piece(own.points, gaps >= TUNED.grown * far, gaps >= far)
    if not extra.any():
        return extra
    lacking = np.median(
        [(own.distances(one.points) >= TUNED.grown * far).mean() for one in partners]
    )
    return extra if lacking < most_lacking * extra.mean() else np.zeros_like(extra)


class Disks:
    """A surface as disks around its points, each in the tangent plane and as wide as points are apart.

    Parameters
    ----------
    points, normals : ndarray, shape (l, 3)
        The normals are of unit length.
    """

    def __init__(self, points: FloatArray, normals: FloatArray) -> None:
        self.points, self._normals, self._tree = points, normals, scipy.spatial.cKDTree(points)
        self._spacing = float(np.median(self._tree.query(points, k=2)[0][:, 1]))

    def distances(self, places: FloatArray) -> FloatArray:
        """Return how far places (p, 3) are from the surface, shape (p,)."""
        nearest: IntArray = self._tree.query(places, k=TUNED.num_nearest)[1]
        arms = places[:, None] - self.points[nearest]
        heights = np.einsum("pka,pka->pk", arms, self._normals[nearest]) ** 2
        beside = np.sqrt(np.maximum((arms * arms).sum(axis=2) - heights, 0.0))
        gaps = heights + np.maximum(beside - self._spacing, 0.0) ** 2
        return np.asarray(np.sqrt(gaps.min(axis=1)))


def _largest_piece(points: FloatArray, near: BoolArray, core: BoolArray) -> BoolArray:
    """Return the connected piece of near points with most of the core, if that is enough of the surface."""
    nearest = scipy.spatial.cKDTree(points).query(points, k=TUNED.num_nearest + 1)[1][:, 1:]
    links = np.stack(
        [np.repeat(np.arange(len(points)), TUNED.num_nearest), nearest.ravel()], axis=1
    )
    links = links[near[links].all(axis=1)]
    piece = vertex_components(len(points), [links])[1]
    counts = np.bincount(piece[core], minlength=1)
    is_enough = counts.max() >= TUNED.least_share * len(points)
    return np.asarray(near & (piece == counts.argmax()) & is_enough)
