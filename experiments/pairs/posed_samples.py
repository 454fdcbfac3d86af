"""Pairs of samples of public collections in random poses, and the true rotation; what cells share is kept."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from collalign.products.matching_input import dense_points, pair_problem
from data_tools.arrays import FloatArray, read_only
from data_tools.embedding.embedding import Samples, sample_shape
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.rotations import random_rotation, rotation_angle_deg
from experiments.collections.landmarked import CLASSES, read_dataset
from experiments.datasets import Dataset
from pairwise.dense.points import DensePoints
from pairwise.problem.problem import Problem

#: Collections by the names that the tables use. Of the teeth, those of one side and all (in O(3)).
TEETH_ONE_SIDE, TEETH_MIXED = "teeth, one side", "teeth, mixed"
COLLECTIONS = (TEETH_ONE_SIDE, TEETH_MIXED, *CLASSES)


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedPair:
    """Two shapes' samples, the source in a random pose.

    Attributes
    ----------
    problem : Problem
    truth : ndarray, shape (3, 3)
        The landmarks' rotation, from the posed source to the target.
    dense : pair of DensePoints, or None
        Dense samples of target and posed source, where there are any.
    """

    problem: Problem
    truth: FloatArray
    dense: tuple[DensePoints, DensePoints] | None

    def errors_deg(self, rotations: FloatArray) -> FloatArray:
        """Return degrees between poses (m, d, d) and the truth; 180 where the chirality is wrong."""
        return np.nan_to_num(rotation_angle_deg(rotations[..., :3, :3], self.truth), nan=180.0)


def pose_pair(target: Samples, source: Samples, truth: FloatArray, group: str, rng: np.random.Generator) -> PosedPair:
    """Turn the source at random.

    Parameters
    ----------
    target, source : Samples
    truth : ndarray, shape (3, 3)
        The rotation from source to target before the turn.
    group : {"SO", "O"}
    rng : numpy.random.Generator
    """
    turn = random_rotation(rng)
    turned = turned_samples(source, turn)
    has_dense = len(target.dense_positions) > 0 and len(source.dense_positions) > 0
    return PosedPair(
        problem=pair_problem(target, turned, group),
        truth=truth @ turn.T,
        dense=(dense_points(target), dense_points(turned)) if has_dense else None,
    )


def turned_samples(samples: Samples, turn: FloatArray) -> Samples:
    """Return the samples of the turned shape."""
    coordinates = samples.coordinates.copy()
    coordinates[:, :3] = coordinates[:, :3] @ turn.T
    return replace(
        samples,
        positions=read_only(samples.positions @ turn.T),
        coordinates=read_only(coordinates),
        dense_positions=read_only(samples.dense_positions @ turn.T),
        dense_normals=read_only(samples.dense_normals @ turn.T),
    )


def read_collection(data: Path, name: str) -> tuple[Dataset, str]:
    """Return a collection by its name in the tables, and the group that its pairs need."""
    if name in CLASSES:
        return read_dataset(name, data), "SO"
    return read_dataset("teeth", data), "SO" if name == TEETH_ONE_SIDE else "O"


def posed_pairs(
    data: Path,
    name: str,
    sampling: SamplingOptions,
    embedding: EmbeddingOptions,
    *,
    num_shapes: int,
    num_pairs: int,
    seed: int,
) -> Iterator[PosedPair]:
    """Yield pairs drawn by the seed among shapes drawn by the seed, in their order.

    Parameters
    ----------
    data : Path
        Folder of the public collections.
    name : str
        One of :data:`COLLECTIONS`.
    sampling : SamplingOptions
    embedding : EmbeddingOptions
    num_shapes, num_pairs : int
        At most; smaller collections give all they have.
    seed : int
        The same shapes, pairs and poses whatever the sampling and the embedding.
    """
    dataset, group = _collection(data, name)
    eligible = np.arange(len(dataset))
    if group == "SO" and dataset.chirality is not None:
        eligible = np.flatnonzero(dataset.chirality == 1)
    rng = np.random.default_rng(seed)
    pairs = list(itertools.combinations(np.sort(rng.permutation(eligible)[:num_shapes]).tolist(), 2))
    for position in np.sort(rng.permutation(len(pairs))[:num_pairs]):
        i, j = pairs[position]
        target, source = (_samples(data, name, s, sampling, embedding) for s in (i, j))
        yield pose_pair(target, source, dataset.rotation(i, j, group=group), group, rng)


@functools.lru_cache(maxsize=len(COLLECTIONS))
def _collection(data: Path, name: str) -> tuple[Dataset, str]:
    return read_collection(data, name)


@functools.lru_cache(maxsize=60)
def _surface(data: Path, name: str, which: int) -> WorkingSurface:
    return WorkingSurface(_collection(data, name)[0].shape(which), SamplingOptions())


@functools.lru_cache(maxsize=1000)
def _samples(data: Path, name: str, which: int, sampling: SamplingOptions, embedding: EmbeddingOptions) -> Samples:
    shape = _collection(data, name)[0].shape(which)
    return sample_shape(shape, sampling, embedding, surface=_surface(data, name, which))
