"""What a person does with a result in a notebook: look, index, tabulate, plot, and take the aligned meshes."""

from __future__ import annotations

import base64
import html
import io
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, overload

import numpy as np

from collalign.output.contact_sheet import contact_sheet, tile_of
from collalign.products.aligned_collection import DOUBT, ConsistentMaps, position_of
from collalign.products.deformation import VertexMaps
from collalign.products.pair import Alternative, Pair
from data_tools.arrays import FloatArray, IntArray, one_line
from data_tools.errors import CollalignError, InputError, OptionsError, UnavailableError
from data_tools.percent import percent
from data_tools.poses import scales_of
from data_tools.surface.shape import Shape

#: Shapes that a notebook shows by themselves, drawn and in a table.
MOST_SHOWN = 12


@dataclass(frozen=True, kw_only=True, eq=False)
class AlignedShape:
    """One shape of a result.

    Attributes
    ----------
    name, file : str
        The file is empty where the shape came from memory.
    transform : ndarray, shape (4, 4)
        File coordinates to the common frame.
    reflected : bool
    confidence : float
        NaN where it is not known.
    part : int
        Shapes of different parts are not aligned with each other.
    alternatives : tuple of Alternative
        Other poses, the likeliest first.
    """

    name: str
    file: str
    transform: FloatArray
    reflected: bool
    confidence: float
    part: int
    alternatives: tuple[Alternative, ...]

    __repr__ = one_line


class Browsable(ABC):
    """The part of a result that is the same for one just made and one read from a folder."""

    # What both kinds of results have; read-only in both.
    names: tuple[str, ...]
    transforms: FloatArray
    confidence: FloatArray
    pairs: tuple[Pair, ...]
    maps: ConsistentMaps
    alternatives: tuple[tuple[Alternative, ...], ...]

    @abstractmethod
    def _locations(self) -> tuple[str, ...]:
        """The file of each shape, empty for memory."""

    @abstractmethod
    def _part_numbers(self) -> IntArray:
        """The part of each shape."""

    @abstractmethod
    def _shape(self, at: int) -> Shape:
        """One shape in file coordinates, for pictures; it may be decimated."""

    @abstractmethod
    def _aligned_shape(self, at: int) -> Shape:
        """One shape in the common frame, at full resolution."""

    def __len__(self) -> int:
        """Number of shapes."""
        return len(self.names)

    def __iter__(self) -> Iterator[AlignedShape]:
        return (self[at] for at in range(len(self)))

    def __contains__(self, shape: object) -> bool:
        """Whether there is a shape of this name."""
        return (shape.name if isinstance(shape, AlignedShape) else shape) in self.names

    @overload
    def __getitem__(self, shape: str | int) -> AlignedShape: ...
    @overload
    def __getitem__(self, shape: slice) -> tuple[AlignedShape, ...]: ...
    def __getitem__(self, shape: str | int | slice) -> AlignedShape | tuple[AlignedShape, ...]:
        """Return one shape by name or position, or the shapes of a slice.

        Raises
        ------
        UnknownName
            If no shape has the name: a ``KeyError`` and an ``InputError``.
        """
        if isinstance(shape, slice):
            return tuple(self[at] for at in range(len(self))[shape])
        at = position_of(self.names, shape)
        return AlignedShape(
            name=self.names[at],
            file=self._locations()[at],
            transform=self.transforms[at],
            reflected=bool(np.linalg.det(self.transforms[at, :3, :3]) < 0),
            confidence=float(self.confidence[at]),
            part=int(self._part_numbers()[at]),
            alternatives=self.alternatives[at],
        )

    @property
    def vertex_maps(self) -> VertexMaps:
        """Maps of all vertices between the shapes, as their files count them.

        Raises
        ------
        InputError
            If the result has none: it was aligned without ``deformable``.
        """
        if self.maps.vertices is None:
            raise InputError("there are no maps of all vertices; align with deformable=True (--deformable)")
        return self.maps.vertices

    def __repr__(self) -> str:
        doubtful = int((self.confidence < DOUBT).sum())
        mirrored = int((np.linalg.det(self.transforms[:, :3, :3]) < 0).sum())
        return (
            f"<{type(self).__name__}: {len(self)} shapes, {len(self.pairs)} pairs, {doubtful} doubtful, "
            f"{mirrored} mirrored>"
        )

    def _repr_html_(self) -> str:
        order = np.argsort(np.where(np.isnan(self.confidence), 2.0, self.confidence), kind="stable")[:MOST_SHOWN]
        picture = self._picture(sorted(order.tolist()))
        rest = f"<p>The {len(order)} of least confidence of {len(self)} shapes.</p>" if len(order) < len(self) else ""
        return f"<p>{html.escape(repr(self))}</p>{picture}{_html_table(self[int(at)] for at in order)}{rest}"

    def _picture(self, chosen: Sequence[int]) -> str:
        """Return some shapes before and after as an HTML image; without their files, a sentence."""
        stream = io.BytesIO()
        try:
            self._sheet(chosen).savefig(stream, format="png")
        except CollalignError as error:
            return f"<p>No picture: {html.escape(str(error))}</p>"
        data = base64.b64encode(stream.getvalue()).decode("ascii")
        return f'<img alt="Shapes before and after alignment" src="data:image/png;base64,{data}">'

    def _sheet(self, chosen: Sequence[int]) -> Any:
        return contact_sheet(
            tile_of(self._shape(at), self.transforms[at], float(self.confidence[at])) for at in chosen
        )

    def plot(self, shapes: Iterable[str | int] | None = None) -> Any:
        """Draw shapes before and after alignment, side by side.

        Parameters
        ----------
        shapes : iterable of str or int, optional
            Names or positions; all by default.

        Returns
        -------
        matplotlib.figure.Figure
        """
        return self._sheet(
            [position_of(self.names, shape) for shape in (range(len(self)) if shapes is None else shapes)]
        )

    def aligned_meshes(self, shapes: Iterable[str | int] | None = None) -> dict[str, Any]:
        """Return shapes in the common frame, at full resolution and as cleaned for matching.

        Parameters
        ----------
        shapes : iterable of str or int, optional
            Names or positions; all by default.

        Returns
        -------
        dict of str to trimesh.Trimesh or trimesh.PointCloud

        Raises
        ------
        InputError
            If a file is not there any more.
        """
        import trimesh

        meshes = {}
        for at in (position_of(self.names, shape) for shape in (range(len(self)) if shapes is None else shapes)):
            shape = self._aligned_shape(at)
            kind = trimesh.Trimesh if shape.is_mesh else trimesh.PointCloud
            parts = (shape.vertices, shape.faces) if shape.is_mesh else (shape.vertices,)
            meshes[self.names[at]] = kind(
                *(part.copy() for part in parts), **({"process": False} if shape.is_mesh else {})
            )
        return meshes

    def to_dataframe(self, of: Literal["shapes", "pairs"] = "shapes") -> Any:
        """Return one row per shape, or per matched pair.

        Parameters
        ----------
        of : {"shapes", "pairs"}

        Returns
        -------
        pandas.DataFrame
            Indexed by the names of the shapes, or of target and source.

        Raises
        ------
        UnavailableError
            If pandas is not installed.
        """
        if of not in ("shapes", "pairs"):
            raise OptionsError(f"of: expected 'shapes' or 'pairs', got {of!r}")
        try:
            import pandas
        except ImportError as error:
            raise UnavailableError(
                "to_dataframe needs pandas; install it with: pip install 'collalign[tables]'"
            ) from error
        if of == "shapes":
            return pandas.DataFrame([_shape_row(shape) for shape in self]).set_index("name")
        columns = ["target", "source", *_PAIR_FIELDS]
        rows = [_pair_row(pair, self.names) for pair in self.pairs]
        return pandas.DataFrame(rows, columns=columns).set_index(["target", "source"])


_PAIR_FIELDS = ("energy", "lower_bound", "status", "chirality_proven", "choice", "inlier", "disagreement_deg")


def _pair_row(pair: Pair, names: tuple[str, ...]) -> dict[str, Any]:
    return {"target": names[pair.target], "source": names[pair.source]} | {
        name: getattr(pair, name) for name in _PAIR_FIELDS
    }


def _shape_row(shape: AlignedShape) -> dict[str, Any]:
    return {
        "name": shape.name,
        "file": shape.file,
        "confidence": shape.confidence,
        "doubtful": not shape.confidence >= DOUBT,
        "mirrored": shape.reflected,
        "scale": float(scales_of(shape.transform)),
        "part": shape.part,
        "alternatives": len(shape.alternatives),
    }


def _html_table(shapes: Iterable[AlignedShape]) -> str:
    rows = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in _cells(shape))}</tr>" for shape in shapes)
    return f"<table><thead><tr><th>shape</th><th>confidence</th><th></th></tr></thead><tbody>{rows}</tbody></table>"


def _cells(shape: AlignedShape) -> tuple[str, str, str]:
    row: Mapping[str, Any] = _shape_row(shape)
    confidence = percent(shape.confidence)
    said = ", ".join(word for word in ("doubtful", "mirrored") if row[word])
    return html.escape(shape.name), confidence, said
