"""Maps of all vertices: ``vertex_maps.npz``, and the reference's colours for all shapes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from collalign.engine.records import from_record
from collalign.products.consistent_maps import VertexMaps
from data_tools.arrays import FloatArray, as_indices
from data_tools.errors import InputError, StoreError
from data_tools.io.archives import load_arrays
from data_tools.io.source import read_source
from data_tools.surface.shape import Shape

VERTEX_MAPS_FILE = "vertex_maps.npz"
#: Grey, and no confidence, of vertices that have no counterpart on the reference.
_NOWHERE = np.array([0.6, 0.6, 0.6, 0.0])


def save_vertex_maps(maps: VertexMaps, path: Path) -> None:
    """Write maps into a compressed npz file.

    ``places`` holds the places of all shapes' vertices one after the other, shape i from ``starts[i]`` to
    ``starts[i + 1]``, in single precision, and ``vertex_confidence`` how sure they are.
    """
    starts = np.concatenate([[0], np.cumsum([len(own) for own in maps.places])])
    np.savez_compressed(
        path,
        names=np.array(maps.names),
        reference=np.array(maps.reference),
        starts=starts,
        places=np.concatenate(maps.places).astype(np.float32),
        confidence=maps.confidence,
        vertex_confidence=np.concatenate(maps.vertex_confidence).astype(np.float32),
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
        data = load_arrays(read_source(path).content, path.name)
        names, every, sure = data["names"].tolist(), data["places"], data["vertex_confidence"]
        starts = as_indices(data["starts"], "starts", upper=len(every) + 1, shape=(len(names) + 1,))
        record = {
            "names": names,
            "reference": data["reference"].item(),
            "places": np.split(every, starts[1:-1]),
            "confidence": data["confidence"],
            "vertex_confidence": np.split(sure, starts[1:-1]),
            "left_out": data["left_out"].tolist(),
        }
        maps = from_record(VertexMaps, record, path.name)
        wrong_size = len(maps.confidence) != len(names) or len(sure) != len(every)
        if maps.reference not in names or (np.diff(starts) < 0).any() or wrong_size:
            raise InputError("the reference, the starts or the confidences are impossible")
    except (KeyError, ValueError, OSError, StoreError) as error:
        raise InputError(f"{path}: not maps of vertices ({error})") from None
    return maps


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
        """Return colours of a shape's vertices, (v + 1, 4) with confidence; the last are of no counterpart."""
        if name not in self._maps.names:
            return _NOWHERE[None]
        at = self._maps.names.index(name)
        extent = self._high - self._low
        shares = (self._maps.places[at] @ self._axes - self._low) / np.where(
            extent > 0, extent, 1.0
        )
        colours = 0.08 + 0.84 * np.clip(shares, 0.0, 1.0)
        colours = np.column_stack([colours, self._maps.vertex_confidence[at]])
        return np.vstack([np.where(np.isfinite(colours), colours, _NOWHERE), _NOWHERE])


def at_vertices(colours: FloatArray, shape: Shape) -> FloatArray:
    """Return what the vertices of a shape, some of those of its file, have of colours or numbers.

    Parameters
    ----------
    colours : ndarray, shape (f,) or (f, d)
        Of the file's vertices; the last one is that of all others.
    shape : Shape
    """
    return np.asarray(colours[np.minimum(shape.file_indices, len(colours) - 1)])
