"""What the page of shape change holds: a decimated mean, and every shape and component as offsets from it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from collalign.analysis.symmetry import ObjectSymmetry
from collalign.engine.store.records import json_types
from collalign.output.report.payload import pack, sample_colors
from collalign.output.views import UNNAMED, camera, display_mesh
from collalign.products.named_frame import NamedFrame
from collalign.tools.variation.shape_statistics import ShapeTests, procrustes_scores, symmetry_rows
from collalign.tools.variation.surface_variation import NUM_COMPONENTS, QUALITY_HEADING, SurfaceVariation
from data_tools.arrays import FloatArray
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.normals import vertex_normals

#: Triangles of the mean that is drawn, and what all shapes together may have.
_MOST_FACES, _FEWEST_FACES, _FACES_IN_ALL = 8_000, 1_500, 700_000
_LARGEST = int(np.iinfo(np.int16).max)
#: How much more than the mean is in view, for what is moved away from it.
_ROOM = 1.1


def build_variation(
    variation: SurfaceVariation,
    columns: dict[str, tuple[str, ...]],
    landmarks: tuple[tuple[str, ...], FloatArray],
    tests: ShapeTests,
    symmetry: ObjectSymmetry | None = None,
    frame: NamedFrame = UNNAMED,
) -> tuple[dict[str, Any], dict[str, str]]:
    """Collect the page's content.

    Parameters
    ----------
    variation : SurfaceVariation
    columns : dict of str to tuple of str
        Labels of the shapes, "" where unknown.
    landmarks : (names, points)
        Points (l, 3) on the mean, in its coordinates; NaN where a landmark is on no template.
    tests : ShapeTests
        Of the same columns.
    symmetry : ObjectSymmetry, optional
    frame : NamedFrame
        From where the surfaces are looked at first.

    Returns
    -------
    document : dict
        JSON types only.
    blobs : dict of str to str
        Base64 text by the element's id.
    """
    num = len(variation.names)
    most = int(np.clip(_FACES_IN_ALL // num, _FEWEST_FACES, _MOST_FACES))
    vertices, faces = display_mesh(variation.mean, variation.faces, max_faces=most)
    places = SurfaceLocator(variation.mean, variation.faces).closest(vertices)
    mean = places.on(variation.mean)
    count = min(NUM_COMPONENTS, len(variation.components.shares))
    deviations = np.sqrt(variation.components.variances[:count])
    axes = [d * places.on(axis) for d, axis in zip(deviations, variation.components.axes[:count], strict=True)]
    surfaces = {
        "mean": mean,
        "axes": np.array(axes),
        "shapes": np.stack([places.on(shape) - mean for shape in variation.shapes]),
    }
    if symmetry is not None:
        parts = [symmetry.directional, *symmetry.asymmetric]
        surfaces |= {
            "symmetricMean": places.on(symmetry.mean),
            "asymmetric": np.stack([places.on(part) for part in parts]),
        }
    if variation.quality is not None:
        relative = variation.quality.distances / variation.quality.radii[:, None]
        surfaces["distances"] = relative[:, places.nearest]
    steps = {name: float(np.abs(values).max()) / _LARGEST or 1.0 for name, values in surfaces.items()}
    arrays: dict[str, NDArray[Any]] = {
        **{name: np.round(values / steps[name]).astype(np.int16) for name, values in surfaces.items()},
        "faces": faces.astype(np.uint16 if len(mean) <= np.iinfo(np.uint16).max else np.uint32),
        "colors": np.round(255 * sample_colors(mean[None])).astype(np.uint8),
    }
    fields, text = pack(arrays)
    view = camera([(mean, faces)], frame)
    document = {
        "kind": "variation",
        "camera": {"R": view, "extent": _ROOM * np.abs(mean @ view.T).max(axis=0) / np.abs(mean).max()},
        "names": variation.names,
        "tables": tests.tables,
        "factors": tests.factors,
        "tests": {
            "sumsOfSquares": tests.options.sums_of_squares,
            "permutations": tests.options.permutations,
            "seed": tests.options.seed,
        },
        "columns": columns,
        "centroidSizes": variation.centroid_sizes,
        "fields": fields,
        "steps": steps,
        "numVertices": len(mean),
        "shares": variation.components.shares[:count],
        "deviations": deviations,
        "scores": procrustes_scores(variation.components)[:, :count],
        "landmarks": _shown(variation, *landmarks),
        "quality": None if variation.quality is None else [QUALITY_HEADING, *variation.quality.rows],
        "symmetry": None if symmetry is None else _asymmetries(symmetry),
    }
    return dict(json_types(document)), {"variation": text}


def _asymmetries(symmetry: ObjectSymmetry) -> dict[str, Any]:
    return {
        "asymmetry": symmetry.asymmetry,
        "fluctuating": symmetry.fluctuating,
        "anova": symmetry_rows(symmetry.anova),
    }


def _shown(variation: SurfaceVariation, names: tuple[str, ...], points: FloatArray) -> dict[str, Any]:
    """Return the landmarks on the mean with outward directions, by which the page hides some; 0 on a cloud."""
    known = np.asarray(np.isfinite(points).all(axis=1))
    points, normals = points[known], np.zeros((int(known.sum()), 3))
    if len(points) and len(variation.faces):
        places = SurfaceLocator(variation.mean, variation.faces).closest(points)
        normals = places.on(vertex_normals(variation.mean, variation.faces))
    shown = [name for name, there in zip(names, known, strict=True) if there]
    return {"names": shown, "points": points, "normals": normals}
