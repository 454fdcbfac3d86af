"""What non-rigid matching returns: a map of all vertices, its alternatives, and how far it can be trusted."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from collalign.confidence.map_model import Evidence
from collalign.nonrigid.map_evidence import MIXED_ORIENTATION
from collalign.output.vertex_maps import at_vertices
from collalign.wording import note_text
from data_tools.arrays import FloatArray, IntArray
from data_tools.io.files import write_atomic
from data_tools.io.objects import ShapeLike, as_origin
from data_tools.io.output_folder import OutputFolder
from data_tools.io.shapes import read_shape
from data_tools.notes import Note
from data_tools.options import AS_STORED
from data_tools.percent import percent

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
        "signs" or "poses"; in experiments also the paper's "relaxation".
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
        One vertex of the target file for each vertex of the source file; -1 outside the largest component.
    point_map_source_target : ndarray of int, shape (number of target vertices,)
        The inverse direction, found in the same way; not necessarily the inverse permutation.
    functional_map : ndarray, shape (m, m)
        C_source_target: coefficients on the target to coefficients on the source.
    candidates : tuple of NonrigidCandidate
        Distinct maps, the chosen one first, then by score.
    dense_source : ndarray of int, shape (s,)
        Vertices of the source file at which the candidates are given.
    confidence : float
        Probability that at least 90 % of the source's points are within .1 sqrt(area) of where they belong; see
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
        target, source : as in :func:`collalign.match_shapes`
            The shapes that were matched.
        """
        from collalign.tools.match.pictures import match_figure, vertices_map

        left = read_shape(as_origin(target, self.target_name), AS_STORED, name=self.target_name)
        right = read_shape(as_origin(source, self.source_name), AS_STORED, name=self.source_name)
        point_map = vertices_map(self.point_map_target_source, left, right)
        confidence = at_vertices(np.append(self.vertex_confidence, np.nan), right)
        return match_figure(left, right, point_map, confidence, title=self.summary)

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
        buffer = io.BytesIO()
        np.savez_compressed(
            buffer,
            target_name=self.target_name,
            source_name=self.source_name,
            point_map_target_source=self.point_map_target_source,
            point_map_source_target=self.point_map_source_target,
            functional_map=self.functional_map,
            dense_source=self.dense_source,
            candidate_maps=np.stack([c.map_target_source for c in self.candidates]),
            candidate_scores=np.array([c.evidence.score for c in self.candidates]),
            candidate_orientations=np.array([c.evidence.orientation for c in self.candidates]),
            candidate_origins=np.array([c.origin for c in self.candidates]),
            confidence=self.confidence,
            vertex_confidence=self.vertex_confidence,
            notes=np.array([*map(note_text, self.notes)], dtype=np.str_),
        )
        write_atomic(output.stage("map.npz"), buffer.getvalue())
        write_atomic(output.stage("map.txt"), _lines(self.point_map_target_source))
        write_atomic(output.stage("map_back.txt"), _lines(self.point_map_source_target))


def _lines(point_map: IntArray) -> bytes:
    return "".join(f"{index}\n" for index in point_map.tolist()).encode("ascii")
