"""Non-rigid matching of two shapes, from files to a map of all vertices; reads like section 6.1 of the paper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from collalign.confidence.map_model import Evidence
from collalign.nonrigid.map_evidence import MIXED_ORIENTATION
from collalign.nonrigid.map_options import NonrigidKeywords, NonrigidOptions, SurfaceOptions
from collalign.nonrigid.portfolio import (
    SAME_SHARE,
    Refined,
    same_places,
    trust_of,
)
from collalign.nonrigid.ranked import ranked_maps
from collalign.nonrigid.spectral_shape import SpectralShape, prepare_surface
from collalign.output.vertex_maps import at_vertices
from collalign.tools.match.every_vertex import vertex_maps
from collalign.wording import note_text
from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only
from data_tools.checks import as_options
from data_tools.errors import InputError
from data_tools.io.objects import ShapeLike, as_origin
from data_tools.io.output_folder import OutputFolder
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.notes import Note, percent
from data_tools.options import AS_STORED
from data_tools.rotations import nearest_orthogonal, rotation_angle_deg
from data_tools.threads import one_blas_thread

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True, eq=False)
class NonrigidCandidate:
    """One way to match two shapes.

    Attributes
    ----------
    functional_map : ndarray, shape (m, m)
        C_source_target, the constant function first.
    map_target_source : ndarray of int, shape (s,)
        Vertex of the target file for each of ``NonrigidMatch.dense_source``.
    evidence : Evidence
    origin : str
        "signs", "tips" or "poses"; in experiments also the paper's "relaxation".
    """

    functional_map: FloatArray
    map_target_source: IntArray
    evidence: Evidence
    origin: str

    @property
    def orientation(self) -> str:
        """One of "preserving", "reversing", "mixed" (part of it each), or "unknown" without normals."""
        value = self.evidence.orientation
        if not np.isfinite(value):
            return "unknown"
        if abs(value) < MIXED_ORIENTATION:
            return "mixed"
        return "preserving" if value > 0 else "reversing"


@dataclass(frozen=True, kw_only=True, eq=False)
class NonrigidMatch:
    """The map between two shapes and what is known about it.

    Attributes
    ----------
    target_name, source_name : str
    point_map_target_source : ndarray of int, shape (number of source vertices,)
        One vertex of the target file for each vertex of the source file; -1 outside the largest component, and where
        the target ends before the counterpart.
    point_map_source_target : ndarray of int, shape (number of target vertices,)
        The inverse direction, found in the same way; not necessarily the inverse permutation.
    functional_map : ndarray, shape (m, m)
        C_source_target: coefficients on the target to coefficients on the source.
    candidates : tuple of NonrigidCandidate
        Distinct maps, the chosen one first, then by score.
    dense_source : ndarray of int, shape (s,)
        Vertices of the source file at which the candidates are given.
    no_counterpart_source, no_counterpart_target : ndarray of bool, shapes as the point maps
        Vertices of the largest component whose counterpart the other surface lacks, because it is cut.
    confidence : float
        Probability that the source's points are less than .1 sqrt(area) from where they belong in the mean; see
        :mod:`collalign.confidence.map_model`.
    vertex_confidence : ndarray, shape (number of source vertices,)
        Probability that the image of each vertex of the source file is within that; NaN where there is none.
    notes : tuple of Note
    """

    target_name: str
    source_name: str
    point_map_target_source: IntArray
    point_map_source_target: IntArray
    functional_map: FloatArray
    candidates: tuple[NonrigidCandidate, ...]
    dense_source: IntArray
    no_counterpart_source: BoolArray
    no_counterpart_target: BoolArray
    confidence: float
    vertex_confidence: FloatArray
    notes: tuple[Note, ...] = ()

    def __repr__(self) -> str:
        num = len(self.point_map_target_source)
        return (
            f"<NonrigidMatch: {self.source_name} on {self.target_name}, {num} vertices, "
            f"confidence {percent(self.confidence)}, {self.orientation}, {len(self.candidates)} candidates>"
        )

    @property
    def orientation(self) -> str:
        """Orientation of the chosen map, see :attr:`NonrigidCandidate.orientation`."""
        return self.candidates[0].orientation

    @property
    def summary(self) -> str:
        """One line: which shapes, how sure the map is, and what becomes of left and right."""
        names = f"{self.source_name} -> {self.target_name}"
        return f"{names}: confidence {percent(self.confidence)}, orientation {self.orientation}"

    def plot(self, target: ShapeLike, source: ShapeLike) -> Figure:
        """Draw both shapes coloured by the map, from the front and from behind; notebooks show the figure.

        Parameters
        ----------
        target, source : as in :func:`collalign.maps.match_shapes`
            The shapes that were matched.
        """
        from collalign.output.views import figure_of
        from collalign.tools.match.pictures import match_picture, vertices_map

        left = read_shape(as_origin(target, self.target_name), AS_STORED, name=self.target_name)
        right = read_shape(as_origin(source, self.source_name), AS_STORED, name=self.source_name)
        point_map = vertices_map(self.point_map_target_source, left, right)
        confidence = at_vertices(np.append(self.vertex_confidence, np.nan), right)
        picture = match_picture(left, right, point_map, confidence, title=self.summary)
        return figure_of(picture)

    def save(self, folder: Path | str) -> tuple[Path, ...]:
        """Write the files of :meth:`stage` in the place of those of an earlier map, each complete or not at all.

        Raises
        ------
        InputError
            If the folder cannot be written, or holds somebody else's file under one of the names.
        """
        with OutputFolder.open(folder, writer="match --nonrigid") as output:
            self.stage(output)
            return output.publish(complete=True)

    def stage(self, output: OutputFolder) -> None:
        """Stage ``map.npz``, ``map.txt`` and ``map_back.txt``.

        ``map.npz`` holds the arrays under the names of the attributes, and of the candidates ``candidate_maps``,
        ``candidate_scores``, ``candidate_orientations`` and ``candidate_origins``.
        ``map.txt`` has one line for each vertex of the source: the vertex of the target, counted from 0, or -1; and
        ``map_back.txt`` one for each vertex of the target. These are the point maps that pyFM (``p2p_21``, the target
        being its first mesh) and geomfum take.
        """
        np.savez_compressed(
            output.stage("map.npz"),
            target_name=self.target_name,
            source_name=self.source_name,
            point_map_target_source=self.point_map_target_source,
            point_map_source_target=self.point_map_source_target,
            functional_map=self.functional_map,
            dense_source=self.dense_source,
            no_counterpart_source=self.no_counterpart_source,
            no_counterpart_target=self.no_counterpart_target,
            candidate_maps=np.stack([c.map_target_source for c in self.candidates]),
            candidate_scores=np.array([c.evidence.score for c in self.candidates]),
            candidate_orientations=np.array([c.evidence.orientation for c in self.candidates]),
            candidate_origins=np.array([c.origin for c in self.candidates]),
            confidence=self.confidence,
            vertex_confidence=self.vertex_confidence,
            notes=np.array([*map(note_text, self.notes)], dtype=np.str_),
        )
        output.stage_text(_lines(self.point_map_target_source), "map.txt")
        output.stage_text(_lines(self.point_map_source_target), "map_back.txt")


def _lines(point_map: IntArray) -> str:
    return "".join(f"{index}\n" for index in point_map.tolist())


#: Maps this far from each other, in degrees, are half turns of each other.
HALF_TURN_DEG = 120.0
#: Of a map that is stated less a user hears that it may be half turned.
SURE = 0.9


@one_blas_thread()
def match_shapes(
    target: ShapeLike,
    source: ShapeLike,
    *,
    options: NonrigidOptions | Mapping[str, Any] | None = None,
    surface_options: SurfaceOptions | Mapping[str, Any] | None = None,
    **keywords: Unpack[NonrigidKeywords],
) -> NonrigidMatch:
    """Match two deformable shapes: one target vertex for each source vertex.

    Parameters
    ----------
    target, source : file, array (n, 3), pair (V, F), or trimesh or Open3D object
        Vertex indices are those of the shapes as given. Rigid poses: :func:`collalign.match_rigid`.
    options : NonrigidOptions or mapping, optional
    surface_options : SurfaceOptions or mapping, optional
    **keywords
        Fields of ``options`` by themselves, which win.

    Returns
    -------
    NonrigidMatch

    Raises
    ------
    InputError
        If a shape cannot be read or is too small for the functions asked for.

    Examples
    --------
    >>> small = {"num_functions": 30, "num_dense": 100}  # quicker, and coarser, than the default
    >>> found = collalign.maps.match_shapes("standing.ply", "bent.ply", surface_options=small)
    >>> found.point_map_target_source[:3].shape  # the vertex of standing.ply for each of bent.ply
    (3,)
    """
    wanted = as_options("options", options, NonrigidOptions, keywords)
    surface = as_options("surface_options", surface_options, SurfaceOptions)
    to, of = (
        prepare_file(as_origin(file, role), surface)
        for file, role in ((target, "target"), (source, "source"))
    )
    return match_prepared(to, of, wanted)


def prepare_file(file: Origin | str, options: SurfaceOptions | None = None) -> SpectralShape:
    """Read and prepare a file: any mesh or point cloud that :func:`data_tools.io.shapes.read_shape` reads."""
    return prepare_surface(read_shape(file, AS_STORED), options)


@one_blas_thread()
def match_prepared(
    target: SpectralShape, source: SpectralShape, options: NonrigidOptions | None = None
) -> NonrigidMatch:
    """Match two prepared shapes; see :func:`match_shapes`.

    Parameters
    ----------
    target, source : SpectralShape
        Of the same number of functions and samples.
    options : NonrigidOptions, optional
    """
    options = options or NonrigidOptions()
    if len(target.eigenvalues) != len(source.eigenvalues):
        raise InputError(
            f"{target.name} has {len(target.eigenvalues)} eigenfunctions, {source.name} {len(source.eigenvalues)}: "
            "prepare both with the same options"
        )
    found = ranked_maps(target, source, options)
    maps = vertex_maps(target, source, found[0])
    return match_of(target, source, found, maps, num_candidates=options.num_candidates)


def match_of(
    target: SpectralShape,
    source: SpectralShape,
    found: list[Refined],
    maps: tuple[IntArray, IntArray],
    *,
    num_candidates: int,
) -> NonrigidMatch:
    """Return candidates, the chosen one first, and its maps of the files' vertices, (v,) each, as a match."""
    forward, backward = maps
    confidence, at_vertices = trust_of(target, source, found)
    lacking = [
        (shape.to_working >= 0) & (images < 0)
        for shape, images in ((source, forward), (target, backward))
    ]
    return NonrigidMatch(
        target_name=target.name,
        source_name=source.name,
        point_map_target_source=read_only(forward),
        point_map_source_target=read_only(backward),
        functional_map=read_only(found[0].functional_map.C_source_target),
        candidates=tuple(_public(target, candidate) for candidate in found[:num_candidates]),
        dense_source=read_only(source.to_original[source.dense]),
        no_counterpart_source=read_only(lacking[0]),
        no_counterpart_target=read_only(lacking[1]),
        confidence=confidence,
        vertex_confidence=read_only(np.where(forward >= 0, at_vertices[source.to_working], np.nan)),
        notes=(
            *(
                replace(note, shapes=(s.name, *note.shapes))
                for s in (target, source)
                for note in s.notes
            ),
            *_cut_notes((source, target), lacking),
            *(_half_turned(target, source, found) if confidence < SURE else ()),
        ),
    )


def _cut_notes(
    shapes: tuple[SpectralShape, SpectralShape], lacking: list[BoolArray]
) -> tuple[Note, ...]:
    """Return which share of either shape has no counterpart on the other one, if any has none."""
    return tuple(
        Note(
            "no-counterpart",
            (one.name,),
            {"other": other.name, "share": float(gone.sum() / (one.to_working >= 0).sum())},
        )
        for one, other, gone in zip(shapes, shapes[::-1], lacking, strict=True)
        if gone.any()
    )


def _half_turned(
    target: SpectralShape, source: SpectralShape, found: list[Refined]
) -> tuple[Note, ...]:
    """Return a note if the best different map that keeps left and right is a half turn of the first one."""
    shares = same_places(target, found, 0).mean(axis=1)
    others = [
        one
        for one, share in zip(found, shares, strict=True)
        if share < SAME_SHARE and one.evidence.orientation > 0
    ]
    if not others:
        return ()
    places = target.vertices[target.dense] - target.mass @ target.vertices
    own, other = (
        places[one.functional_map.map_target_source]
        for one in (found[0], min(others, key=lambda one: one.score))
    )
    turn = nearest_orthogonal(other.T @ own, determinant=1.0)
    if rotation_angle_deg(turn) < HALF_TURN_DEG:
        return ()
    axis = np.linalg.eigh(turn + turn.T)[1][:, -1]
    longest = np.linalg.svd(places, full_matrices=False)[2][0]
    is_long = abs(float(axis @ longest)) > np.cos(np.pi / 4)
    ends = "front and back" if is_long else "the two ends"
    return (Note("map-half-turned", (source.name, target.name), {"exchanged": ends}),)


def _public(target: SpectralShape, candidate: Refined) -> NonrigidCandidate:
    forward = candidate.functional_map.map_target_source
    return NonrigidCandidate(
        functional_map=read_only(candidate.functional_map.C_source_target),
        map_target_source=read_only(target.to_original[target.dense[forward]]),
        evidence=candidate.evidence,
        origin=candidate.origin,
    )
