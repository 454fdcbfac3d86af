"""The paper's own chain (section 6.1): PM-SDP, local minimisation in 30 functions, functional-map ICP."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from collalign.nonrigid.functional_map import FunctionalMap, mutual_nearest_rows
from collalign.nonrigid.map_starts import candidate_mask, descend_maps
from collalign.nonrigid.portfolio import Refined, refined_with_evidence
from collalign.nonrigid.spectral_shape import SpectralShape
from collalign.tools.match.nonrigid import NonrigidMatch, match_of
from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.rotations import nearest_orthogonal
from pairwise.local_search import LocalMinima, MatchingCosts
from pairwise.pm_sdp.rounding import appendix_starts, nearest_map
from pairwise.problem import Problem
from pairwise.relaxations import solve_pm_sdp
from pairwise.results import RelaxationResult, Status

#: Share of the target's samples that each sample may match, by average geodesic distance.
PAPER_SHARE = 0.3
#: Functions of the relaxation with a banded R, and with a diagonal one in the fast chain; half-width of the band.
BANDED_DIM, DIAGONAL_DIM, BANDWIDTH = 17, 30, 2
#: Relative gap at which the relaxation stops: its rounding does not change any more.
GAP_TOL = 1e-3
#: ICP has settled when no entry of the rotation changes by more, or after so many steps.
_SETTLED, _MOST_STEPS = 1e-10, 1000


@dataclass(frozen=True, kw_only=True)
class PaperChain:
    """The paper's settings.

    Attributes
    ----------
    is_fast : bool
        Its fast version: a diagonal R in 30 functions in place of a 5-diagonal one in 17.
    num_source : int
        Samples of the source that are matched to all samples of the target; the paper's k.
    share : float
        Of the target's samples that each sample may match, by average geodesic distance.
    num_candidates : int
        Local minima that are refined.
    bandwidth : int
        Half-width of the band of R.
    time_limit_s : float, optional
        Of the relaxation.
    """

    is_fast: bool = False
    num_source: int = 50
    share: float = PAPER_SHARE
    num_candidates: int = 6
    bandwidth: int = BANDWIDTH
    time_limit_s: float | None = None


def match_by_paper(
    target: SpectralShape, source: SpectralShape, chain: PaperChain
) -> tuple[NonrigidMatch, Status]:
    """Return the map of the paper's chain, and how the relaxation ended; there is no judgement between candidates.

    PM-SDP on 50 samples of the source and 100 of the target, local minimisation in 30 functions, and functional-map
    ICP on the dense samples; the minimum of least energy is the answer.
    """
    samples = source.samples[: chain.num_source]
    allowed = candidate_mask(agd_gaps(target, source, samples), chain.share)
    minima, status = relaxation_starts(target, source, samples, allowed, chain)
    origin = "fast" if chain.is_fast else "paper"
    found: list[Refined] = [
        refined_with_evidence(target, source, icp_map(target, source, rotation), origin)
        for rotation in minima.rotations[: chain.num_candidates]
    ]
    forward, backward = dense_point_maps(target, source, found[0].functional_map.C_source_target)
    maps = in_files(forward, target, source), in_files(backward, source, target)
    return match_of(target, source, found, maps, num_candidates=len(found)), status


def agd_gaps(target: SpectralShape, source: SpectralShape, source_samples: IntArray) -> FloatArray:
    """Return how much the average geodesic distances of samples differ, in units of sqrt(area), shape (n, k)."""
    return np.abs(target.agd[target.samples][:, None] - source.agd[source_samples])


def relaxation_starts(
    target: SpectralShape,
    source: SpectralShape,
    source_samples: IntArray,
    allowed: BoolArray,
    chain: PaperChain,
) -> tuple[LocalMinima, Status]:
    """Return the local minima that roundings of PM-SDP lead to, best energy first, and how its solver ended.

    They come from the four roundings of the paper's appendix A, first in the relaxation's functions, then in 30.
    """
    dim, bandwidth = (DIAGONAL_DIM, 0) if chain.is_fast else (BANDED_DIM, chain.bandwidth)
    problem = Problem.from_user(
        target.functions[target.samples, :dim],
        source.functions[source_samples, :dim],
        group="O",
        allowed=allowed,
        rotation_pattern=bandwidth,
    )
    relaxed = solve_pm_sdp(problem, row_sums=False, tol=GAP_TOL, time_limit_s=chain.time_limit_s)
    maps, sizes = rounded_maps(problem, relaxed), (dim, DIAGONAL_DIM)
    return descend_maps(
        target, source, source_samples, allowed, maps, "relaxation", sizes=sizes
    ), relaxed.status


def rounded_maps(problem: Problem, relaxed: RelaxationResult) -> IntArray:
    """Return distinct maps of the samples, shape (m, k): the one nearest to X, and those of the appendix's starts."""
    by_rotation = MatchingCosts(problem).assign(
        problem.pattern.project(appendix_starts(problem, relaxed))
    )
    return np.unique(np.vstack([nearest_map(problem, relaxed.X), by_rotation]), axis=0)


def icp_map(
    target: SpectralShape, source: SpectralShape, rotation_target_source: FloatArray
) -> FunctionalMap:
    """Return functional-map ICP on the dense samples, with the constant function put in front of its map."""
    dim = len(rotation_target_source)
    on_target, on_source = (
        target.functions[target.dense, :dim],
        source.functions[source.dense, :dim],
    )
    found = icp(on_target, on_source, rotation_target_source)
    c_source_target = np.eye(dim + 1)
    c_source_target[1:, 1:] = found.C_source_target
    return replace(found, C_source_target=c_source_target)


def icp(
    basis_target: FloatArray, basis_source: FloatArray, rotation_target_source: FloatArray
) -> FunctionalMap:
    """Refine a rotation of the eigenfunctions by nearest neighbours and orthogonal projection in turn.

    Functional-map ICP (Ovsjanikov et al. 2012, section 6; Maron et al. 2016, section 6.1).

    Parameters
    ----------
    basis_target, basis_source : ndarray, shapes (u, d) and (v, d)
        Eigenfunctions at the vertices used, as many as the rotation has columns.
    rotation_target_source : ndarray, shape (d, d)
        Where to start.

    Returns
    -------
    FunctionalMap
        With ``C_source_target`` the transpose of the final rotation.
    """
    rotation = rotation_target_source
    for _ in range(_MOST_STEPS):
        point_map = mutual_nearest_rows(basis_target, basis_source @ rotation.T)[0]
        before, rotation = rotation, nearest_orthogonal(basis_target[point_map].T @ basis_source)
        if np.abs(rotation - before).max() <= _SETTLED:
            break
    forward, backward = mutual_nearest_rows(basis_target, basis_source @ rotation.T)
    return FunctionalMap(
        C_source_target=np.ascontiguousarray(rotation.T),
        map_target_source=forward,
        map_source_target=backward,
    )


def dense_point_maps(
    target: SpectralShape, source: SpectralShape, c_source_target: FloatArray
) -> tuple[IntArray, IntArray]:
    """Return the point maps between all working vertices that belong to a functional map, in both directions.

    Curvature is left out here: it steers the fit of the map as a whole, but for single vertices it can jump.

    Returns
    -------
    map_target_source : ndarray of int, shape (w_source,)
    map_source_target : ndarray of int, shape (w_target,)
    """
    size = len(c_source_target)
    return mutual_nearest_rows(target.basis[:, :size], source.basis[:, :size] @ c_source_target)


def in_files(working_map: IntArray, target: SpectralShape, source: SpectralShape) -> IntArray:
    """Return a map between working vertices as one between those of the files, -1 where there is none, shape (v,)."""
    return np.where(source.to_working >= 0, target.to_original[working_map[source.to_working]], -1)
