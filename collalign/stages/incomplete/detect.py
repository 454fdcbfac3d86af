"""Which shapes are incomplete: those that a person names, and those beyond whose rim the others go on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from collalign.confidence.incomplete_model import MISSING_SHARE
from collalign.engine.job import Shared, table_of_values
from collalign.options import ALL, AUTO, NEVER, AlignOptions, AlignSession
from collalign.products.pair import AlignedPair
from collalign.products.shapes import Shapes
from collalign.stages.incomplete.posed_points import beyond_rim
from data_tools.arrays import FloatArray
from data_tools.embedding.embedding import Samples
from data_tools.embedding.surface_points import cloud_rim, one_sided, plane_normals
from data_tools.names import known_names
from data_tools.partial_surface import PartialSurface
from data_tools.poses import Similarity, moved_by, scales_of
from pairwise.partial_match import refine, scales_allowed

#: Codes of reasons: a person named the shape, an earlier run found it, similar shapes go on beyond its rim, or its
#: pose is surer as that of a part of them.
NAMED, FOUND, CUT_OFF, LIKELIER = "named", "found-before", "cut-off", "likelier-as-part"
#: Shapes that each is compared with: those of least energy.
NUM_PARTNERS = 6
#: Only where so much of the least share that is missing lies beyond the rim at the common pose is that refined. Of 93
#: cut and whole molars and skulls, those found had .084 and more there; below .043 the share grew by less than .03.
NEARLY_MISSING = 0.5
#: Dense samples of either surface that are refined on, and that a shape needs.
NUM_POINTS = 200
#: Memory of a surface with its grid of a quarter of a MiB, in that of its points alone.
GRID_GROWTH = 14.0
#: Fewer shapes cannot tell which of them is incomplete, nor can they where more than this share seems to be. Nor
#: does the rim of a shape tell anything that has more than the last share of its points there.
MIN_COMPLETE_SHAPES, MOST_MISSING, MOST_ON_RIM = 5, 0.5, 1 / 3


def named_incomplete(
    options: AlignOptions, names: Sequence[str], found: Iterable[str] = ()
) -> dict[int, str]:
    """Return the positions of the shapes that ``options.incomplete`` names, or that an earlier run has found.

    Raises
    ------
    InputError
        If there is no shape of a name.
    """
    if options.incomplete in (AUTO, NEVER):
        return {names.index(name): FOUND for name in sorted(found) if options.incomplete == AUTO}
    if options.incomplete == ALL:
        return dict.fromkeys(range(len(names)), NAMED)
    asked = [name.strip() for name in options.incomplete.split(",") if name.strip()]
    named = known_names("incomplete", asked, names)
    return {names.index(name): NAMED for name in sorted(named.values())}


def find_incomplete(
    session: AlignSession, shapes: Shapes, pairs: Sequence[AlignedPair], transforms: FloatArray
) -> dict[int, str]:
    """Return the shapes beyond whose rim those that match them best go on, and the code of that reason.

    Works on the dense samples at the poses (N, 4, 4) that they have as if all were complete, from which each shape is
    first refined on its partners; shapes that have too few of them are not looked at. A mesh can only be incomplete
    if its surface is open, and objects that are assembled of components have borders everywhere.
    """
    samples = shapes.samples
    if shapes.are_assembled:
        return {}
    are_dense = [len(item.dense_positions) >= NUM_POINTS for item in samples]
    if sum(are_dense) < MIN_COMPLETE_SHAPES or not any(item.may_be_cut for item in samples):
        return {}
    pairs = [pair for pair in pairs if are_dense[pair.target] and are_dense[pair.source]]
    nearest = _nearest(pairs, len(samples))
    points = [posed_samples(item, pose) for item, pose in zip(samples, transforms, strict=True)]
    with table_of_values(points) as table:
        surfaces = [
            Shared(key=str(i), reader=PartialSurface, growth=GRID_GROWTH)
            for i in range(len(samples))
        ]
        tasks = {
            i: {"surface": surfaces[i], "partners": tuple(surfaces[j] for j in nearest[i])}
            for i in sorted(
                range(len(nearest)), key=lambda i: sorted(nearest[i])
            )  # partners in common together
            if nearest[i] and samples[i].may_be_cut and 0.0 < points[i].on_rim.mean() <= MOST_ON_RIM
        }
        shares = session.map_parallel("incomplete shapes", share_beyond, tasks, shared=table)
    missing = [i for i in range(len(samples)) if shares.get(i, 0.0) >= MISSING_SHARE]
    return dict.fromkeys(missing, CUT_OFF)


def are_too_many(num_missing: int, num: int) -> bool:
    """Return whether so many of some shapes seem to be incomplete that the others cannot tell."""
    return num_missing > MOST_MISSING * num or num - num_missing < MIN_COMPLETE_SHAPES


def posed_samples(samples: Samples, transform: FloatArray) -> PartialSurface:
    """Return the dense samples of a shape at its transform (4, 4); what has wide gaps around it is the rim."""
    raw = samples.dense_positions * samples.scale + samples.offset
    points = moved_by(transform, raw)
    rotation = transform[:3, :3] / scales_of(transform)
    is_oriented = len(samples.dense_normals) > 0
    normals = (
        samples.dense_normals @ rotation.T
        if is_oriented
        else one_sided(points, plane_normals(points, points))
    )
    return PartialSurface(
        points=points, normals=normals, on_rim=cloud_rim(points, normals), oriented=is_oriented
    )


def share_beyond(surface: PartialSurface, partners: Sequence[PartialSurface]) -> float:
    """Return the share of its partners' points that lie beyond a surface's rim, their median; runs in a worker.

    Where it is small at the common pose, no refinement makes it large.
    """
    share = beyond_rim(surface, partners, _as_it_lies())
    if share < NEARLY_MISSING * MISSING_SHARE:
        return share
    return beyond_rim(surface, partners, refined_on(partners, surface))


def refined_on(partners: Sequence[PartialSurface], surface: PartialSurface) -> Similarity:
    """Return the pose of a surface that lies among its partners, refined by what has a counterpart there."""
    scales = scales_allowed(partners, surface)
    return refine(partners, surface, _as_it_lies(), num_points=NUM_POINTS, scale_range=scales)


def _as_it_lies() -> Similarity:
    return Similarity.rigid(np.eye(3)[None], np.zeros((1, 3)))


def _nearest(pairs: Iterable[AlignedPair], num: int) -> list[list[int]]:
    """Return the partners of each shape whose pairs have least energy at the common poses."""
    energies: list[list[tuple[float, int]]] = [[] for _ in range(num)]
    for pair in pairs:
        energies[pair.target].append((pair.energy, pair.source))
        energies[pair.source].append((pair.energy, pair.target))
    return [[other for _, other in sorted(found)[:NUM_PARTNERS]] for found in energies]
