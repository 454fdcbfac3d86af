"""Surfaces of a collection as points with normals and rims, one job per file, each result kept in the store."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from collalign.confidence.incomplete_model import BEYOND
from collalign.engine.job import Job, Results
from collalign.options import AlignSession
from collalign.products.shapes import Shapes
from collalign.stages.shape_stage import compute_surfaces, wanted_file
from data_tools.embedding.surface_points import spread_points
from data_tools.errors import CollectionError
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.local_surface import FEWEST_POINTS
from data_tools.options import CleaningOptions
from data_tools.partial_surface import MOST_POINTS, PartialSurface
from data_tools.poses import Similarity
from pairwise.features.overlap import closeness
from pairwise.partial_match import describe_both


def points_of_file(
    path: Origin, name: str, digest: str, cleaning: CleaningOptions
) -> PartialSurface:
    """Read one surface, unless it has changed since its digest was taken; runs inside a worker."""
    return spread_points(read_shape(path, cleaning, name=name, digest=digest), MOST_POINTS)


#: Reads a surface. The version changes whenever the same file would give other points.
READING = Job(kind="surfaces", version="points-3", run=points_of_file, reader=PartialSurface)


def prepare_points(
    session: AlignSession, shapes: Shapes, chosen: Sequence[int]
) -> Results[int, PartialSurface]:
    """Return the points of some shapes, by position.

    Raises
    ------
    CollectionError
        If a file cannot be read any more.
    """
    wanted = {i: wanted_file(READING, session, shapes, i) for i in chosen}
    found = compute_surfaces(READING, session, shapes, wanted)
    if found.failures:
        raise CollectionError(
            "; ".join(f"{shapes.names[i]}: {reason}" for i, reason in found.failures.items())
        )
    return found


def part_mismatch(
    surface: PartialSurface, partners: Sequence[PartialSurface], pose: Similarity
) -> float:
    """Return how the neighbourhoods of a surface mismatch those of the most similar partner at the first pose.

    The mismatch of any two neighbourhoods is 1. What the surface lacks of a partner does not count. NaN where the
    points are too few.
    """
    moved = surface.moved(pose.transform[0])
    still, there = np.eye(3)[None], np.zeros((1, 3))
    found = []
    for partner in partners:
        to, own = describe_both(partner, moved)
        if len(own.points) < FEWEST_POINTS:
            return float("nan")
        sides = (own,) if partner.oriented and surface.oriented else (own, own.reversed())
        found += [float(closeness(to, one, still, there)[1][0, 1]) for one in sides]
    return min(found)


def beyond_rim(
    surface: PartialSurface, partners: Sequence[PartialSurface], pose: Similarity
) -> float:
    """Return the share of its partners' points that lie beyond a surface's rim at the first pose, their median."""
    tree, shares = scipy.spatial.cKDTree(pose.apply(surface.points)[0]), []
    for partner in partners:
        distances, nearest = tree.query(partner.points)
        shares.append(
            float(((distances > BEYOND * partner.radius) & surface.on_rim[nearest]).mean())
        )
    return float(np.median(shares))
