"""Preparing shapes from files, and keeping what was prepared beside them for the next pair."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

from collalign.nonrigid.options import SurfaceOptions
from collalign.nonrigid.surface import SpectralShape, prepare_surface
from collalign.nonrigid.symmetry import self_maps
from data_tools.errors import InputError
from data_tools.io.files import existing_file
from data_tools.io.shapes import read_shape
from data_tools.options import CleaningOptions
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread

#: Files are read as stored, so that vertex indices are those of the file.
AS_STORED = CleaningOptions(merge_vertices=False, largest_component=False)
#: Raised whenever prepared shapes change their meaning, so that older ones are not used.
CACHE_VERSION = 1


@one_blas_thread()
def prepare_shape(shape: Shape, options: SurfaceOptions | None = None) -> SpectralShape:
    """Prepare a shape for non-rigid matching, its symmetries included.

    Raises
    ------
    InputError
        If the largest component has too few vertices for the functions or samples asked for.
    """
    prepared = prepare_surface(shape, options)
    return replace(prepared, self_maps=self_maps(prepared))


@one_blas_thread()
def prepare_file(
    file: Path | str, options: SurfaceOptions | None = None, *, cache: Path | str | None = None
) -> SpectralShape:
    """Read and prepare a file, or take what was prepared from the same content with the same options before.

    Parameters
    ----------
    file : Path or str
        Any mesh or point cloud that :func:`data_tools.io.shapes.read_shape` reads.
    options : SurfaceOptions, optional
    cache : Path or str, optional
        Folder for prepared shapes; nothing is kept without it.
    """
    options = options or SurfaceOptions()
    path = existing_file(Path(file))
    if cache is None:
        return prepare_shape(read_shape(path, AS_STORED), options)
    key = hashlib.sha256(path.read_bytes() + repr((CACHE_VERSION, path.suffix, options)).encode()).hexdigest()[:24]
    kept = Path(cache) / f"{key}.npz"
    if kept.exists():
        try:
            return replace(SpectralShape.load(kept), name=path.stem)
        except InputError:
            kept.unlink()
    prepared = prepare_shape(read_shape(path, AS_STORED), options)
    prepared.save(kept)
    return prepared
