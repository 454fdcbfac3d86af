"""Two shapes that overlap in part, by themselves: the best pose of one on the other, its rivals, and the overlap."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np

from collalign.confidence.incomplete_model import PAIR_WEIGHT, share_of_best
from collalign.options import TwoShapeKeywords, TwoShapeOptions
from data_tools.arrays import FloatArray
from data_tools.checks import as_options
from data_tools.embedding.surface_points import spread_points
from data_tools.io.objects import ShapeLike, as_origin
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin, location
from data_tools.percent import percent
from data_tools.threads import one_blas_thread
from pairwise.partial.match import PartialPose, match_partial
from pairwise.partial.surface import MOST_POINTS, PartialSurface


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
    """

    target_file: str
    source_file: str
    target: str
    source: str
    poses: tuple[PartialPose, ...]

    @property
    def transforms(self) -> FloatArray:
        """The answer and its rivals, shape (m, 4, 4): coordinates of the source to those of the target."""
        return np.stack([found.pose.transform for found in self.poses])

    @property
    def transform(self) -> FloatArray:
        """The answer, shape (4, 4)."""
        return np.asarray(self.transforms[0])

    @property
    def confidence(self) -> float:
        """The chance that the answer is right, by how much worse its best rival fits."""
        turns = np.stack([found.pose.rotation for found in self.poses])
        return share_of_best(turns, -PAIR_WEIGHT * np.log([pose.energy for pose in self.poses]))

    def __repr__(self) -> str:
        best = self.poses[0]
        overlaps = f"{percent(best.overlap_source)} of it on {percent(best.overlap_target)} of the other"
        return f"<PartialMatch: {self.source} on {self.target}, {overlaps}, confidence {percent(self.confidence)}>"

    def record(self) -> dict[str, Any]:
        """Return what ``match.json`` holds."""
        return {
            "target": self.target_file,
            "source": self.source_file,
            "partial": True,
            "confidence": self.confidence,
            "transform": self.transform.tolist(),
            "candidates": [
                {
                    "transform": transform.tolist(),
                    "energy": found.energy,
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
    """Match two shapes of which each may lack what the other has, by what has a counterpart.

    Rotations, shifts and sizes are searched, since centroids and sizes of different parts say nothing. Sizes stay
    where ``options.sampling.normalisation`` is "none", as for scans of one object.

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
        If a shape cannot be read or is too small.

    Examples
    --------
    >>> from data_tools.datasets.synthetic_shapes import blob
    >>> whole = blob(np.random.default_rng(0), num_vertices=400).vertices
    >>> quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> found = collalign.match_in_part(whole, whole[whole[:, 0] < 0.3] @ quarter)
    >>> bool(np.allclose(found.transform[:3, :3], quarter, atol=0.1))
    True
    """
    options = as_options("options", options, TwoShapeOptions, keywords)
    origins = as_origin(target, "target"), as_origin(source, "source")
    to, of = (_partial_surface(origin, options) for origin in origins)
    sizes = (1.0, 1.0) if options.sampling.normalisation == "none" else None
    poses = match_partial(to, of, group=options.group, scale_range=sizes, num_candidates=8)
    target_file, source_file = (location(origin) for origin in origins)
    names = [origin.name.removesuffix(origin.suffix) for origin in origins]
    return PartialMatch(
        target_file=target_file, source_file=source_file, target=names[0], source=names[1], poses=poses
    )


def _partial_surface(origin: Origin, options: TwoShapeOptions) -> PartialSurface:
    found = spread_points(read_shape(origin, options.cleaning), MOST_POINTS)
    return PartialSurface.from_user(found.points, found.normals, found.on_rim, oriented=found.oriented)
