"""A scan on its model: poses of an open shape on a closed one, on which all of it lies."""

from __future__ import annotations

from data_tools.embedding.surface_points import centre_and_radius, surface_cells
from data_tools.local_surface import PART_CELL
from data_tools.surface.outliers import FEWEST_OF_SCAN, without_outliers
from data_tools.surface.shape import Shape
from data_tools.surface.topology import is_open_surface
from pairwise.features.on_whole import MOST_LARGER, TwoScales


def is_closed(shape: Shape) -> bool:
    """Return whether a shape is a mesh without a rim."""
    return shape.is_mesh and not is_open_surface(shape.vertices, shape.faces)


def both_scales(whole: Shape, part: Shape) -> tuple[TwoScales, TwoScales] | None:
    """Return the surfaces of a whole and of a part, in cells of the whole's size, without stray points of a cloud.

    None where there are too few points, or the part is much larger than the whole.
    """
    if not part.is_mesh:
        part = without_outliers(part, fewest_points=FEWEST_OF_SCAN)
    radius = centre_and_radius(whole)[1]
    if centre_and_radius(part)[1] > MOST_LARGER * radius:
        return None
    cell = PART_CELL * radius
    both = [
        TwoScales(coarse, fine)
        for shape in (whole, part)
        if (coarse := surface_cells(shape, cell)) and (fine := surface_cells(shape, 0.5 * cell))
    ]
    return (both[0], both[1]) if len(both) == 2 else None
