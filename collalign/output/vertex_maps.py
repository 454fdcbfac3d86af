"""Maps of all vertices in files: ``vertex_maps.npz``, and a picture of all shapes in the reference's colours."""

from __future__ import annotations

import itertools
import zipfile
from pathlib import Path

import numpy as np

from collalign.products.deformation import VertexMaps
from data_tools.arrays import FloatArray, IntArray, as_floats, as_indices, read_only
from data_tools.errors import InputError
from data_tools.surface.shape import Shape

VERTEX_MAPS_FILE = "vertex_maps.npz"
VERTEX_MAPS_PICTURE = "vertex_maps.png"
#: Vertices are kept as 32-bit integers.
_MAX_VERTICES = 2**31
#: Of vertices that have no counterpart on the reference.
_GREY = np.full(3, 0.6)


def save_vertex_maps(maps: VertexMaps, path: Path) -> None:
    """Write maps into a compressed npz file.

    ``to_reference`` holds the maps of all shapes one after the other, shape i from ``starts[i]`` to
    ``starts[i + 1]``; ``from_reference`` has one row for each shape.
    """
    starts = np.concatenate([[0], np.cumsum([len(own) for own in maps.to_reference])])
    np.savez_compressed(
        path,
        names=np.array(maps.names),
        reference=np.array(maps.reference),
        starts=starts,
        to_reference=np.concatenate(maps.to_reference).astype(np.int32),
        from_reference=np.stack(maps.from_reference).astype(np.int32),
        residuals=maps.residuals,
        left_out=np.array(maps.left_out, dtype=str).reshape(-1, 2),
    )


def load_vertex_maps(folder: Path | str) -> VertexMaps:
    """Read the maps of a result.

    Parameters
    ----------
    folder : path

    Raises
    ------
    InputError
        If the folder has none (it was aligned without ``--deformable``), or the file is damaged.
    """
    path = Path(folder) / VERTEX_MAPS_FILE
    if not path.is_file():
        raise InputError(f"{path}: there is none; align with --deformable to map all vertices")
    try:
        with np.load(path, allow_pickle=False) as data:
            names = tuple(str(name) for name in data["names"])
            starts = as_indices(
                data["starts"], "starts", upper=len(data["to_reference"]) + 1, shape=(len(names) + 1,)
            )
            onto = as_indices(
                data["from_reference"], "from_reference", lower=-1, upper=_MAX_VERTICES, shape=(len(names), None)
            )
            every = as_indices(data["to_reference"], "to_reference", lower=-1, upper=onto.shape[1], shape=(None,))
            residuals = as_floats(data["residuals"], "residuals", shape=(len(names),))
            reference, left_out = str(data["reference"]), data["left_out"]
        if reference not in names or (np.diff(starts) < 0).any():
            raise InputError("the reference or the starts are impossible")
    except (KeyError, ValueError, OSError, zipfile.BadZipFile, InputError) as error:
        raise InputError(f"{path}: not maps of vertices ({error})") from None
    return VertexMaps(
        names=names,
        reference=reference,
        to_reference=tuple(read_only(every[a:b]) for a, b in itertools.pairwise(starts)),
        from_reference=tuple(read_only(row) for row in onto),
        residuals=read_only(residuals),
        left_out=tuple((str(name), str(reason)) for name, reason in left_out),
    )


class PlaceColours:
    """Colours of all shapes' vertices by the place on the reference that they are mapped to.

    Parameters
    ----------
    maps : VertexMaps
    reference : Shape
        With the vertices of its file.
    """

    def __init__(self, maps: VertexMaps, reference: Shape) -> None:
        self._maps = maps
        self._colours = np.tile(_GREY, (maps.from_reference[0].shape[0] + 1, 1))
        self._colours[_in_file(reference)] = _by_place(reference.vertices)

    def of_file(self, name: str) -> FloatArray:
        """Return the colours of the vertices of a shape's file, then grey: that of vertices without counterpart."""
        if name not in self._maps.names:
            return _GREY[None].copy()
        onto = self._maps.to_reference[self._maps.names.index(name)]
        return np.asarray(self._colours[np.append(onto, -1)])


def at_vertices(colours: FloatArray, shape: Shape) -> FloatArray:
    """Return the colours of the vertices of a shape, some of those of its file, shape (v, 3).

    Parameters
    ----------
    colours : ndarray, shape (f, 3)
        Of the file's vertices; the last one is that of all others.
    shape : Shape
    """
    return np.asarray(colours[np.minimum(_in_file(shape), len(colours) - 1)])


def _in_file(shape: Shape) -> IntArray:
    return np.arange(len(shape.vertices)) if shape.source_indices is None else shape.source_indices


def _by_place(vertices: FloatArray) -> FloatArray:
    """Return red, green and blue by place: coordinates in the principal axes, shape (v, 3)."""
    centred = vertices - vertices.mean(axis=0)
    places = centred @ np.linalg.eigh(centred.T @ centred)[1]
    low, high = places.min(axis=0), places.max(axis=0)
    return np.asarray(0.08 + 0.84 * (places - low) / np.where(high > low, high - low, 1.0))
