"""Packs arrays for the browser: quantised meshes, typed arrays, gzip, base64.

The browser undoes it with its own ``DecompressionStream``; ``viewer/src/data.js`` is the reader.
"""

from __future__ import annotations

import base64
import gzip
from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from data_tools.arrays import FloatArray, IntArray

#: Stands for a missing coordinate.
MISSING, _LARGEST = int(np.iinfo(np.int16).min), int(np.iinfo(np.int16).max)

#: Name, type and length of each array of a pack, in order.
Fields = list[tuple[str, str, int]]


def pack(arrays: Mapping[str, NDArray[Any]]) -> tuple[Fields, str]:
    """Concatenate arrays, compress and encode them for the browser.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        Integer or float32 arrays; written little-endian in the order given.

    Returns
    -------
    fields : list of (name, type, length)
        What the reader needs to take them apart.
    text : str
        Base64; the same arrays give the same text.
    """
    fields = [(name, array.dtype.name, int(array.size)) for name, array in arrays.items()]
    little = (array.astype(array.dtype.newbyteorder("<")) for array in arrays.values())
    raw = b"".join(array.tobytes() for array in little)
    return fields, base64.b64encode(gzip.compress(raw, compresslevel=9, mtime=0)).decode("ascii")


def pack_mesh(
    vertices: FloatArray, faces: IntArray, samples: FloatArray, scalars: ArrayLike = ()
) -> tuple[dict[str, Any], str]:
    """Pack one display mesh with its samples, positions in 16 bits.

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
    samples : ndarray, shape (k, 3)
        In the same coordinates; NaN where missing.
    scalars : array_like, shape (v,), (v, 3) or (v, 4), optional
        Values in [0, 1] to colour the vertices by, or red, green and blue, or these and a value.

    Returns
    -------
    info : dict
        ``fields``, and ``centre`` and ``step`` with position = centre + step * integer; the rounding error is at most
        half a step, 1/65534 of the longest side of the bounding box.
    text : str
    """
    every = np.concatenate([vertices, samples])
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    centre = 0.5 * (low + high)
    step = float((high - low).max()) / (2 * _LARGEST) or 1.0
    index = np.uint16 if len(vertices) <= np.iinfo(np.uint16).max else np.uint32
    fields, text = pack(
        {
            "vertices": _quantise(vertices, centre, step),
            "faces": faces.astype(index),
            "samples": _quantise(samples, centre, step),
            "scalars": np.round(255 * np.asarray(scalars, dtype=np.float64))
            .astype(np.uint8)
            .ravel(),
        }
    )
    return {"fields": fields, "centre": centre.tolist(), "step": step}, text


def _quantise(points: FloatArray, centre: FloatArray, step: float) -> NDArray[np.int16]:
    missing = np.isnan(points)
    steps = np.round((np.where(missing, 0.0, points) - centre) / step)
    steps = np.clip(steps, -_LARGEST, _LARGEST)
    return np.where(missing, MISSING, steps).astype(np.int16)


def quaternions(rotations: FloatArray) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Return rotations (m, 3, 3) as the browser gets them: unit quaternions (m, 4), and which are times -1."""
    if not len(rotations):
        return np.empty((0, 4)), np.empty(0, dtype=np.uint8)
    mirrored = np.linalg.det(rotations) < 0
    proper = np.where(mirrored[:, None, None], -rotations, rotations)
    return scipy.spatial.transform.Rotation.from_matrix(proper).as_quat(), mirrored.astype(np.uint8)


def sample_colors(aligned: FloatArray) -> FloatArray:
    """Return a colour for the page of each label, by its mean place, so that neighbours look alike, shape (k, 3).

    Parameters
    ----------
    aligned : ndarray, shape (N, k, 3)
        NaN where missing.
    """
    known = np.asarray(~np.isnan(aligned).any(axis=2))
    totals = np.where(known[..., None], aligned, 0.0).sum(axis=0)
    means = totals / np.maximum(known.sum(axis=0), 1)[:, None]
    low, high = means.min(axis=0), means.max(axis=0)
    return np.asarray(0.08 + 0.84 * (means - low) / np.where(high > low, high - low, 1.0))
