"""Two shapes by themselves: the best pose of one on the other, its alternatives, and what is proven about them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from collalign.confidence.candidate_model import candidate_costs
from collalign.options import AUTO, TwoShapeKeywords, TwoShapeOptions
from collalign.whole_pairs.match_whole import match_whole
from collalign.whole_pairs.problem import dense_points
from data_tools.arrays import FloatArray
from data_tools.checks import as_options
from data_tools.embedding.embedding import Samples, sample_file
from data_tools.io.files import readable_stem
from data_tools.io.objects import ShapeLike, as_origin
from data_tools.io.source import Origin, location
from data_tools.options import CleaningOptions
from data_tools.poses import Similarity, scales_of
from data_tools.surface.cleaning import is_assembled
from data_tools.surface.hidden import differ_in_walls
from data_tools.threads import one_blas_thread
from pairwise.results import Candidate, MatchResult, Status
from pairwise.surface_fit import SurfaceFit, fit_surfaces

#: The mirror image fits much better where its score is so many times smaller: of 40 pairs of molars of two sides 33,
#: of 40 of one side none, and none of these by 1.1 either. Chosen on these.
MUCH_BETTER = 1.3


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RigidMatch:
    """The pose of a source on a target.

    Attributes
    ----------
    target_file, source_file : str
        Empty for shapes that came from memory.
    target, source : Samples
        What was matched; ``vertex_indices`` count the vertices of the shapes as given.
    result : MatchResult
        Poses and maps of the samples, best first.
    scores : ndarray, shape (m,)
        What the poses are ranked by, best first: energies times how much neighbourhoods mismatch there, as
        :func:`collalign.confidence.candidate_model.candidate_costs` weighs them; without ``refine`` energies.
    refined : tuple of SurfaceFit
        Each of these poses refined on dense samples; empty without them.
    mirror_score : float
        What the best pose of the source's mirror image would have in ``scores``; NaN where nobody asked.
    """

    target_file: str
    source_file: str
    target: Samples
    source: Samples
    result: MatchResult
    scores: FloatArray
    refined: tuple[SurfaceFit, ...] = ()
    mirror_score: float = np.nan

    @property
    def mirror_fits_better(self) -> bool:
        """Whether the mirror image of the source fits so much better that one of the shapes may be mirrored."""
        return bool(self.scores[0] > MUCH_BETTER * self.mirror_score)

    @property
    def transform(self) -> FloatArray:
        """The answer, shape (4, 4): coordinates of the source to those of the target, scale included."""
        return self.transforms[0]

    @property
    def transforms(self) -> FloatArray:
        """The answer and its alternatives, shape (m, 4, 4), refined where they were."""
        poses = [one.pose for one in self.refined] or [
            _pose_of(one) for one in self.result.candidates
        ]
        return np.array([self.transform_of(pose) for pose in poses])

    def __repr__(self) -> str:
        best = self.result.candidates[0]
        reflected = ", reflected" if best.reflected else ""
        return (
            f"<RigidMatch: {self.source.name} on {self.target.name}, energy {best.energy:.3g}{reflected}, "
            f"{len(self.result.candidates)} poses>"
        )

    def transform_of(self, pose: Similarity) -> FloatArray:
        """Return x -> scale_to * (scale * R (x - offset_of) / scale_of + shift) + offset_to, shape (4, 4)."""
        to, of = self.target, self.source
        linear = pose.rotation * (pose.scale * to.scale / of.scale)
        transform = np.eye(4)
        transform[:3, :3] = linear
        transform[:3, 3] = to.offset + to.scale * pose.shift - linear @ of.offset
        return transform

    def record(self) -> dict[str, Any]:
        """Return what ``match.json`` holds: all poses as transforms, and their maps as vertices of the shapes."""
        result = self.result
        return {
            "target": self.target_file,
            "source": self.source_file,
            "status": result.status.name,
            "advice": result.status.value,
            "energy": result.energy,
            "score": float(self.scores[0]),
            "mirror_score": None if np.isnan(self.mirror_score) else self.mirror_score,
            "lower_bound": None if np.isnan(result.lower_bound) else result.lower_bound,
            "transform": self.transform.tolist(),
            "scale": float(scales_of(self.transform)),
            "candidates": [
                self._candidate_record(candidate, refined)
                for candidate, refined in zip_longest(result.candidates, self.refined)
            ],
            "source_vertices": self.source.vertex_indices.tolist(),
        }

    def _candidate_record(self, candidate: Candidate, refined: SurfaceFit | None) -> dict[str, Any]:
        vertices = self.target.vertex_indices
        return {
            "transform": self.transform_of(_pose_of(candidate)).tolist(),
            "energy": candidate.energy,
            "refined": refined
            and {"transform": self.transform_of(refined.pose).tolist(), "energy": refined.energy},
            "reflected": candidate.reflected,
            "map_target_source": vertices[candidate.map_target_source].tolist(),
        }


def _pose_of(candidate: Candidate) -> Similarity:
    """Return the pose of the samples in space."""
    return Similarity(rotation=candidate.R_target_source[:3, :3], scale=1.0, shift=np.zeros(3))


@one_blas_thread()
def match_rigid(
    target: ShapeLike,
    source: ShapeLike,
    *,
    options: TwoShapeOptions | Mapping[str, Any] | None = None,
    **keywords: Unpack[TwoShapeKeywords],
) -> RigidMatch:
    """Match two shapes rigidly, up to scale: the best pose of the source on the target, and its alternatives.

    Parameters
    ----------
    target, source : file, array (n, 3), pair (V, F), or trimesh or Open3D object
    options : TwoShapeOptions or mapping, optional
    **keywords
        Fields of ``options`` by themselves, which win: ``group="O"``.

    Raises
    ------
    InputError
        If a shape cannot be read or is too small.

    Examples
    --------
    >>> found = collalign.match_rigid("bones/A.ply", "bones/B.ply", group="SO")
    >>> found.transform.shape  # from the coordinates of B.ply to those of A.ply
    (4, 4)
    """
    options = as_options("options", options, TwoShapeOptions, keywords)
    origins = as_origin(target, "target"), as_origin(source, "source")
    to, of = _sampled_alike(origins, options)
    result, scores = _ranked(to, of, options, options.group)
    refined = tuple[SurfaceFit, ...]()
    if options.refine and options.sampling.num_dense_points:
        points = dense_points(to), dense_points(of)
        refined = tuple(
            fit_surfaces(*points, one.R_target_source[:3, :3]) for one in result.candidates
        )
    target_file, source_file = map(location, origins)
    return RigidMatch(
        target_file=target_file,
        source_file=source_file,
        target=to,
        source=of,
        result=result,
        scores=scores,
        refined=refined,
    )


def _sampled_alike(origins: Sequence[Origin], options: TwoShapeOptions) -> list[Samples]:
    """Sample two shapes; all components are kept of those that are assembled of several."""

    def sampled(origin: Origin, cleaning: CleaningOptions) -> Samples:
        return sample_file(
            origin.absolute(),
            cleaning,
            options.sampling,
            options.embedding,
            name=readable_stem(origin) if isinstance(origin, Path) else origin.name,
        )

    cleaning = options.cleaning
    found = [sampled(origin, cleaning) for origin in origins]
    notes, are_sided = [one.notes for one in found], [len(one.dense_normals) > 0 for one in found]
    if cleaning.inner == AUTO and differ_in_walls(notes, are_sided):
        cleaning = replace(cleaning, inner="drop")
        found = [sampled(origin, cleaning) for origin in origins]
    if cleaning.components != AUTO:
        return found
    whole = replace(cleaning, components="all")
    return [
        sampled(origin, whole) if is_assembled(one.notes) else one
        for origin, one in zip(origins, found, strict=True)
    ]


@one_blas_thread()
def with_mirror_score(found: RigidMatch, options: TwoShapeOptions) -> RigidMatch:
    """Return a match of shapes as they are with what the best pose of the source's mirror image would have.

    Parameters
    ----------
    found : RigidMatch
    options : TwoShapeOptions
        Of that match; nothing is proven of the mirror image.
    """
    result, scores = _ranked(found.target, found.source, replace(options, certify=False), "O")
    reflected = np.array([one.reflected for one in result.candidates])
    least, as_it_is = (scores[which].min(initial=np.inf) for which in (reflected, ~reflected))
    # Scores of two matches have different units.
    score = least if np.isinf(as_it_is) or not as_it_is > 0 else found.scores[0] * least / as_it_is
    return replace(found, mirror_score=float(score))


def _ranked(
    to: Samples, of: Samples, options: TwoShapeOptions, group: str
) -> tuple[MatchResult, FloatArray]:
    """Return the poses of a source on a target, ranked, and what they are ranked by (m,)."""
    result, mismatches = match_whole(to, of, group, options.of_pair)
    energies = np.array([one.energy for one in result.candidates])
    scores = candidate_costs(energies, mismatches) if options.refine else energies
    order = np.argsort(scores, kind="stable")
    ranked = tuple(result.candidates[n] for n in order)
    is_other = ranked[0].energy > result.energy
    proven_of_other = is_other and result.status is Status.PROVEN_OPTIMAL
    return replace(
        result,
        R_target_source=ranked[0].R_target_source,
        map_target_source=ranked[0].map_target_source,
        energy=ranked[0].energy,
        candidates=ranked,
        status=Status.LOCAL_OPTIMUM if proven_of_other else result.status,
    ), scores[order]
