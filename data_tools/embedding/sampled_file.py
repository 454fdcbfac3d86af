"""From a file to its samples: read, clean, sample and embed."""

from __future__ import annotations

from dataclasses import replace

from data_tools.arrays import read_only
from data_tools.embedding.embedding import Samples, sample_shape
from data_tools.embedding.own_points import OwnPoints
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import MIN_POINTS, CleaningOptions, EmbeddingOptions, SamplingOptions


def sample_file(
    file: Origin,
    cleaning: CleaningOptions,
    sampling: SamplingOptions,
    embedding: EmbeddingOptions,
    *,
    name: str,
    digest: str | None = None,
    own: OwnPoints | None = None,
) -> Samples:
    """Read, clean, sample and embed one shape; ``vertex_indices`` count the vertices of the file.

    A shape of fewer points than ``sampling.num_points`` is sampled at all that it has.

    Parameters
    ----------
    file : Path or Source
    cleaning : CleaningOptions
    sampling : SamplingOptions
    embedding : EmbeddingOptions
    name : str
    digest : str, optional
        Of the content that is expected: a file that has changed since is refused.
    own : OwnPoints, optional
        What the caller gives of this shape.

    Raises
    ------
    InputError
        If the file cannot be read, has changed or holds no usable shape.
    """
    shape = read_shape(file, cleaning, name=name, digest=digest)
    surface = WorkingSurface(shape, sampling)
    num = len(surface.shape.vertices)
    fewer = MIN_POINTS <= num < sampling.num_points
    samples = sample_shape(
        shape,
        replace(sampling, num_points=num) if fewer else sampling,
        embedding,
        surface=surface,
        own=None if own is None else own.of_shape(shape),
    )
    return replace(samples, vertex_indices=read_only(shape.file_indices[samples.vertex_indices]))
