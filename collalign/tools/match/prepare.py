"""Preparing shapes from files."""

from __future__ import annotations

from dataclasses import replace

from collalign.nonrigid.map_options import SurfaceOptions
from collalign.nonrigid.surface.spectral_shape import SpectralShape, SpectrumOf, prepare_surface
from collalign.tools.match.self_maps import self_maps
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import AS_STORED
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread


@one_blas_thread()
def prepare_shape(
    shape: Shape, options: SurfaceOptions | None = None, *, spectrum_of: SpectrumOf | None = None
) -> SpectralShape:
    """Prepare a shape for non-rigid matching, its symmetries included; see :func:`prepare_surface`.

    Raises
    ------
    InputError
        If the largest component has too few vertices for the functions or samples asked for.
    """
    prepared = prepare_surface(shape, options, spectrum_of=spectrum_of)
    return replace(prepared, self_maps=self_maps(prepared))


@one_blas_thread()
def prepare_file(
    file: Origin | str, options: SurfaceOptions | None = None, *, digest: str | None = None
) -> SpectralShape:
    """Read and prepare a file: any mesh or point cloud that :func:`data_tools.io.shapes.read_shape` reads.

    With the ``digest`` that its content had when it was looked at first, it is refused if it has changed since.
    """
    return prepare_shape(read_shape(file, AS_STORED, digest=digest), options)
