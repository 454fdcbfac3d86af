"""Pairs as synchronization takes them, and one pose per shape from them: the robust way, and the paper's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from collalign.confidence.candidate_model import candidate_costs
from collalign.options import AlignOptions
from collalign.products.pair import Pair, are_weighed
from collalign.products.shapes import Constraints
from collalign.synchronization import (
    PairGraph,
    SynchronizationResult,
    alternate_assignments,
    synchronize_graph,
)
from data_tools.arrays import read_only
from data_tools.embedding.embedding import Samples
from data_tools.threads import one_blas_thread
from pairwise.rotation_pattern import RotationPattern


@one_blas_thread()
def pair_graph(
    pairs: Sequence[Pair],
    num_shapes: int,
    group: str,
    *,
    block_sizes: tuple[int, ...] = (3,),
    energies_alone: bool = False,
) -> PairGraph:
    """Return the graph of the pairs' candidates.

    Parameters
    ----------
    pairs : sequence of Pair
    num_shapes : int
    group : {"SO", "O"}
    block_sizes : tuple of int
        Blocks of the embedding that are kept, from the first on; the rotations of space alone by default.
    energies_alone : bool
        Leave out what dense points say of the candidates, as the paper does.

    Examples
    --------
    >>> collection = collalign.load("aligned")
    >>> collalign.pair_graph(collection.pairs, len(collection), collection.group).num_edges
    3
    """
    dim = sum(block_sizes)
    return PairGraph.of_candidates(
        np.array([(pair.target, pair.source) for pair in pairs], dtype=np.int64),
        [
            (
                pair.rotations[:, :dim, :dim],
                pair.energies
                if energies_alone
                else candidate_costs(pair.energies, pair.mismatches),
            )
            for pair in pairs
        ],
        num_shapes=num_shapes,
        pattern=RotationPattern.from_user(
            block_sizes if len(block_sizes) > 1 else None, dim, group
        ),
        log_odds=[pair.log_odds for pair in pairs] if are_weighed(pairs) else None,
        weights=np.array([pair.weight for pair in pairs]),
    )


def synchronize_pairs(
    options: AlignOptions,
    num_shapes: int,
    pairs: Sequence[Pair],
    constraints: Constraints = Constraints(),  # noqa: B008
) -> SynchronizationResult:
    """Synchronize the pairs' rotations of space.

    Parameters
    ----------
    options : AlignOptions
        With a decided group.
    num_shapes : int
    pairs : sequence of Pair
    constraints : Constraints, optional
    """
    published = options.synchronization == "spectral"
    graph = pair_graph(pairs, num_shapes, options.group, energies_alone=published)
    return synchronize_graph(
        graph,
        method=options.synchronization,
        fixed=constraints.fixed,
        reference=constraints.reference,
    )


def synchronize_shapes(
    options: AlignOptions,
    samples: Sequence[Samples],
    pairs: Sequence[Pair],
    constraints: Constraints,
    *,
    known: SynchronizationResult | None = None,
) -> SynchronizationResult:
    """Return one rotation of space per shape, by the method that ``options.synchronization`` asks for.

    Parameters
    ----------
    options : AlignOptions
        With a decided group.
    samples : sequence of Samples
    pairs : sequence of Pair
    constraints : Constraints
    known : SynchronizationResult, optional
        Of exactly these pairs without constraints, where one has been computed already.
    """
    if options.synchronization == "spectral":
        return synchronize_as_published(options, samples, pairs, constraints)
    if known is not None and not constraints.fixed and constraints.reference == 0:
        return known
    return synchronize_pairs(options, len(samples), pairs, constraints)


def synchronize_as_published(
    options: AlignOptions,
    samples: Sequence[Samples],
    pairs: Sequence[Pair],
    constraints: Constraints,
) -> SynchronizationResult:
    """Synchronize exactly as appendix B of Maron et al. (2016) does, the baseline.

    The eigenprojection of the pairs' best rotations, block by block in mixed embeddings, then exact assignments of
    all pairs and rotations in closed form, in turn until nothing changes. Shapes set by hand stay where they are.

    Returns
    -------
    SynchronizationResult
        With rotations of space, shape (N, 3, 3).
    """
    blocks = samples[0].block_sizes
    graph = pair_graph(pairs, len(samples), options.group, block_sizes=blocks, energies_alone=True)
    solution = synchronize_graph(graph, method="spectral", reference=constraints.reference)
    frames, _, _ = alternate_assignments(
        [item.coordinates for item in samples], solution.rotations, pattern=graph.pattern
    )
    poses = np.ascontiguousarray(frames[:, :3, :3])
    first, given = next(iter(constraints.fixed.items()), (constraints.reference, np.eye(3)))
    poses = given @ poses[first].T @ poses
    for shape, pose in constraints.fixed.items():
        poses[shape] = pose
    return replace(solution, rotations=read_only(poses))
