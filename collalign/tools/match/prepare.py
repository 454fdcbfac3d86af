"""Preparing shapes for non-rigid matching: their surfaces, and their maps to themselves that nearly preserve them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.map_tuning import TUNED
from collalign.nonrigid.portfolio import (
    Refined,
    candidates_from_within,
    distinct_maps,
    is_same_map,
    judged,
    screening_refiner,
)
from collalign.nonrigid.surface.spectral_shape import SpectralShape, SpectrumOf, prepare_surface
from data_tools.arrays import FloatArray, read_only
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import AS_STORED
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread

#: Most self-maps that are kept.
NUM_SELF_MAPS = 8
#: Functions of which one at a time is negated, and how many functions start such a map at least.
NUM_NEGATED, MIN_NEGATED_SIZE = 24, 12


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
def prepare_file(file: Origin | str, options: SurfaceOptions | None = None) -> SpectralShape:
    """Read and prepare a file: any mesh or point cloud that :func:`data_tools.io.shapes.read_shape` reads."""
    return prepare_shape(read_shape(file, AS_STORED), options)


def self_maps(shape: SpectralShape) -> FloatArray:
    """Return functional maps of a shape to itself, best evidence first, the identity left out, shape (s, q, q).

    A wrong map between two shapes is most often the right one followed by such a self-map: left for right, front for
    back, or both. With the self-maps each is obtained from any other. They are found by the same search as between
    two shapes, and by negating one eigenfunction at a time: swapping front and back of a flat body leaves all lower
    functions alone.
    """
    own = replace(shape, self_maps=read_only(np.empty((0, 0, 0))))
    searched = candidates_from_within(own, own, NonrigidOptions(num_candidates=NUM_SELF_MAPS))
    candidates = distinct_maps([*searched, *_negations(own)])
    maps = [candidate.functional_map.C_source_target for candidate in candidates]
    size = min([TUNED.num_composed, *(len(c) for c in maps)])
    kept = [c[:size, :size] for c in maps if not is_same_map(c, np.eye(len(c)))]
    return read_only(np.array(kept[:NUM_SELF_MAPS]).reshape(-1, size, size))


def _negations(shape: SpectralShape) -> list[Refined]:
    """Return the refined self-maps that start from the identity with one function negated."""
    refiner = screening_refiner(shape, shape)
    found = []
    for function in range(min(NUM_NEGATED, len(shape.eigenvalues))):
        signs = np.ones(min(max(function + 1, MIN_NEGATED_SIZE), len(shape.eigenvalues)))
        signs[function] = -1.0
        found.append(judged(shape, shape, refiner.from_rotation(np.diag(signs)), "negation"))
    return found
