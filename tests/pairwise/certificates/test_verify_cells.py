"""Proofs by quasi-bounds: valid for every kind of problem, and refused where the cells do not tile the rotations."""

from dataclasses import replace

import numpy as np
import pytest

from data_tools.errors import InputError
from pairwise import Problem, verify_certificate
from pairwise.branch_and_bound.prove import depths_of, prove, searches_of
from pairwise.branch_and_bound.tilted import prove_tilted
from pairwise.certificates.verify import proven_bound
from pairwise.certificates.verify_cells import tilted_bound
from pairwise.problem import energy_scale
from pairwise.results import Status
from tests.pairwise.branch_and_bound.test_tilted import tilted_problem
from tests.rigid_problems import planted_cube


@pytest.fixture(scope="module")
def problem():
    return Problem.from_user(*planted_cube(12, 0.1, 3))


@pytest.fixture(scope="module")
def certificate(problem):
    proof = prove(problem, record=True)
    assert proof.status is Status.PROVEN_OPTIMAL
    assert proof.certificate.bound >= (1 - 2e-3) * proof.candidate.energy
    return proof.certificate


def test_cells_that_do_not_tile_the_rotations_are_refused(problem, certificate):
    depths = certificate.arrays["proper_depths"].astype(np.int64)
    deepest = int(depths.argmax())
    for wrong in (
        depths[1:],
        depths[:-1],
        np.append(depths, 0),
        depths[:0],
        depths + 1,
        np.delete(depths, deepest),
    ):
        with pytest.raises(InputError, match="tile"):
            proven_bound(problem, "cells", {**certificate.arrays, "proper_depths": wrong})
    for wrong in (depths - 1, np.full_like(depths, 61)):
        with pytest.raises(InputError, match="depths"):
            proven_bound(problem, "cells", {**certificate.arrays, "proper_depths": wrong})


def test_any_cells_prove_what_is_true_and_larger_ones_less(problem, certificate):
    for depth in (0, 3, 6, 9):
        arrays = {**certificate.arrays, "proper_depths": np.full(4 << depth, depth)}
        assert proven_bound(problem, "cells", arrays) < certificate.bound
        with pytest.raises(InputError, match="claims"):
            verify_certificate(problem.target, problem.source, replace(certificate, arrays=arrays))


def test_a_proof_for_rotations_is_none_for_reflections(problem, certificate):
    both = Problem.from_user(problem.target, problem.source, group="O")
    with pytest.raises(InputError, match="reflected"):
        proven_bound(both, "cells", certificate.arrays)


def cells_of(proof):
    """The depths of the cells of each chirality."""
    return np.split(proof.depths, np.cumsum(proof.num_cells)[:-1])


@pytest.mark.parametrize("seed", range(6))
def test_a_proof_that_is_stopped_at_any_time_claims_no_more_than_its_cells_prove(seed):
    problem, tilt = tilted_problem(seed)
    scale = energy_scale(problem) + float(np.abs(tilt).sum())
    proof = prove_tilted(
        problem, tilt, np.eye(problem.dim)[None], gap=1e-2 * scale, time_limit_s=1e-9
    )
    assert tilted_bound(problem, tilt, cells_of(proof)) >= proof.lower_bound - 1e-9 * scale
    zero = np.zeros_like(tilt)
    searches = sorted(searches_of(problem, None, 1e-3), key=lambda search: search.reflected)
    for _ in range(40):
        for search in searches:
            search._split(1, np.inf)
            search.run(0.0, np.inf)
        claim = min(search.bound for search in searches)
        assert tilted_bound(problem, zero, depths_of(searches)) >= claim - 1e-9 * scale
