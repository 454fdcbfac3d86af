"""Maps of all vertices: ``vertex_maps.npz``, and the reference's colours for all shapes."""

from __future__ import annotations

import itertools
import zipfile
from pathlib import Path

import numpy as np

from collalign.products.deformation import VertexMaps
from data_tools.arrays import FloatArray, as_floats, as_indices, read_only
from data_tools.errors import InputError
from data_tools.surface.shape import Shape

VERTEX_MAPS_FILE = "vertex_maps.npz"
#: Of vertices that have no counterpart on the reference.
_GREY = np.full(3, 0.6)


def save_vertex_maps(maps: VertexMaps, path: Path) -> None:
    """Write maps into a compressed npz file.

    ``places`` holds the places of all shapes' vertices one after the other, shape i from ``starts[i]`` to
    ``starts[i + 1]``, in single precision.
    """
    starts = np.concatenate([[0], np.cumsum([len(own) for own in maps.places])])
    np.savez_compressed(
        path,
        names=np.array(maps.names),
        reference=np.array(maps.reference),
        starts=starts,
        places=np.concatenate(maps.places).astype(np.float32),
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
            starts = as_indices(data["starts"], "starts", upper=len(data["places"]) + 1, shape=(len(names) + 1,))
            every = _places(data["places"])
            residuals = as_floats(data["residuals"], "residuals", shape=(len(names),))
            reference, left_out = str(data["reference"]), data["left_out"]
        if reference not in names or (np.diff(starts) < 0).any():
            raise InputError("the reference or the starts are impossible")
    except (KeyError, ValueError, OSError, zipfile.BadZipFile, InputError) as error:
        raise InputError(f"{path}: not maps of vertices ({error})") from None
    return VertexMaps(
        names=names,
        reference=reference,
        places=tuple(read_only(every[a:b]) for a, b in itertools.pairwise(starts)),
        residuals=read_only(residuals),
        left_out=tuple((str(name), str(reason)) for name, reason in left_out),
    )


class PlaceColours:
    """Colours of all shapes' vertices by their places on the reference."""

    def __init__(self, maps: VertexMaps) -> None:
        self._maps = maps
        of_reference = maps.places[maps.names.index(maps.reference)]
        known = of_reference[np.isfinite(of_reference).all(axis=1)]
        self._axes = np.linalg.eigh(np.cov(known.T))[1]
        placed = known @ self._axes
        self._low, self._high = placed.min(axis=0), placed.max(axis=0)

    def of_file(self, name: str) -> FloatArray:
        """Return the colours of the vertices of a shape's file, then grey: that of vertices without counterpart."""
        if name not in self._maps.names:
            return _GREY[None].copy()
        extent = self._high - self._low
        shares = (self._maps.places[self._maps.names.index(name)] @ self._axes - self._low) / np.where(
            extent > 0, extent, 1.0
        )
        return np.vstack([np.where(np.isfinite(shares), 0.08 + 0.84 * np.clip(shares, 0.0, 1.0), _GREY), _GREY])


def at_vertices(colours: FloatArray, shape: Shape) -> FloatArray:
    """Return the colours of the vertices of a shape, some of those of its file, shape (v, 3).

    Parameters
    ----------
    colours : ndarray, shape (f, 3)
        Of the file's vertices; the last one is that of all others.
    shape : Shape
    """
    return np.asarray(colours[np.minimum(shape.file_indices, len(colours) - 1)])


def _places(values: FloatArray) -> FloatArray:
    """Check and return places of vertices: points, or NaN where there are none."""
    missing = np.isnan(np.asarray(values)).all(axis=-1, keepdims=True)
    places = as_floats(np.where(missing, 0.0, values), "places", shape=(None, 3))
    return np.where(missing, np.nan, places)
