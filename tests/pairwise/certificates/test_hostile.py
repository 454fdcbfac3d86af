"""Certificates that somebody forged: each is refused by name, or proves no more than is true."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from data_tools.errors import InputError
from pairwise import Certificate, Problem, verify_certificate
from pairwise.branch_and_bound.prove import prove
from pairwise.certificates.certificate import MAX_BYTES
from pairwise.certificates.verify import proven_bound
from pairwise.relaxations import solve_pm_sdp
from tests.oracles import brute_force
from tests.problems import in_unit


@pytest.fixture(scope="module")
def problem():
    rng = np.random.default_rng(4)
    return Problem.from_user(rng.random((5, 3)), rng.random((5, 3)))


@pytest.fixture(scope="module")
def proofs(problem):
    return {
        "cells": prove(problem, tol=1e-2, record=True).certificate,
        "pm-sdp": solve_pm_sdp(problem).certificate,
    }


def forged(certificate, **arrays):
    return replace(certificate, arrays={**certificate.arrays, **arrays}, bound=-1e300)


def check(problem, certificate):
    return verify_certificate(problem.target, problem.source, certificate, problem=problem)


@pytest.mark.parametrize("kind", ["cells", "pm-sdp"])
def test_a_certificate_in_single_precision_proves_what_its_numbers_prove(problem, proofs, kind):
    if (
        kind == "pm-sdp"
    ):  # at convergence F is so close to singular that single precision makes it indefinite
        proofs = {kind: solve_pm_sdp(problem, max_iterations=4).certificate}
    single = {
        n: a.astype(np.float32)
        if n not in ("weights", "constant_cost") and a.dtype.kind == "f"
        else a
        for n, a in proofs[kind].arrays.items()
    }
    bound = check(problem, forged(proofs[kind], **single))
    again = {n: a.astype(np.float64) if a.dtype == np.float32 else a for n, a in single.items()}
    assert bound == check(problem, forged(proofs[kind], **again))
    assert bound <= brute_force(problem).energy


@pytest.mark.parametrize("kind", ["cells", "pm-sdp"])
@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("unmatched_costs", np.full(5, 999_999.0)),
        ("max_unmatched", np.array(999_999)),
        ("max_unmatched", np.array(-3)),
        ("proper_paths", np.ones((5, 5), dtype=bool)),
        ("gamma", np.zeros(3)),
        (3, np.zeros(3)),
    ],
)
def test_arrays_of_another_kind_are_refused(problem, proofs, kind, name, values):
    arrays = {**proofs[kind].arrays, name: values}
    with pytest.raises(InputError, match="certificate"):
        check(problem, replace(proofs[kind], arrays=arrays))
    with pytest.raises(InputError, match="certificate"):
        proven_bound(problem, kind, arrays)


@pytest.mark.parametrize("values", [None, [[1.0]], "array", np.ones((5, 9, 9), dtype=object)])
def test_what_is_no_array_of_numbers_is_refused(problem, proofs, values):
    with pytest.raises(InputError):
        check(problem, forged(proofs["pm-sdp"], F=values))


@pytest.mark.parametrize("field", ["kind", "problem_hash", "bound", "arrays"])
@pytest.mark.parametrize(
    "value", [None, 7.0, "x", [], ["cells"], np.zeros(2), 1j, float("nan"), float("inf")]
)
def test_fields_of_other_types_are_refused(problem, proofs, field, value):
    with pytest.raises(InputError):
        check(problem, replace(proofs["cells"], **{field: value}))


def test_impossible_matches_must_be_impossible(problem, proofs):
    for rows in ([[0, 0]], [[-1, 0]], [[0, 5]], [[0, 0], [1, 1]]):
        with pytest.raises(InputError, match="impossible"):
            check(problem, forged(proofs["pm-sdp"], impossible=np.array(rows)))


def test_any_row_sums_prove_a_true_bound_and_better_ones_than_those_given_are_no_claim(
    problem, proofs
):
    certificate, optimum = proofs["pm-sdp"], brute_force(problem).energy
    row_u = certificate.arrays["row_u"]
    assert row_u.any()
    rng = np.random.default_rng(1)
    for size in (1e-3, 0.1, 10.0):
        changed = row_u + size * rng.standard_normal(row_u.shape)
        assert check(problem, forged(certificate, row_u=changed)) <= optimum
        with pytest.raises(InputError, match="claims the bound"):
            check(problem, replace(forged(certificate, row_u=changed), bound=certificate.bound))
    with pytest.raises(InputError, match="claims the bound"):
        check(
            problem,
            replace(forged(certificate, row_u=np.zeros_like(row_u)), bound=certificate.bound),
        )
    with pytest.raises(InputError, match="row_u has shape"):
        check(problem, forged(certificate, row_u=row_u[1:]))


def test_row_sums_of_target_points_that_a_map_can_leave_out_are_refused():
    rng = np.random.default_rng(2)
    allowed = np.array([[1, 1, 0], [1, 1, 0], [0, 0, 1], [0, 0, 1]], dtype=bool)
    problem = Problem.from_user(rng.random((4, 3)), rng.random((3, 3)), allowed=allowed)
    certificate = solve_pm_sdp(problem).certificate
    row_u = certificate.arrays["row_u"].copy()
    assert check(problem, certificate) <= brute_force(problem).energy
    row_u[3] = 1e-9
    with pytest.raises(InputError, match="target point 3, which a map can leave out"):
        check(problem, forged(certificate, row_u=row_u))


@pytest.mark.parametrize(
    ("unit", "weight"),
    [*((unit, 1.0) for unit in (1e-60, 1e-12, 1.0, 1e12, 1e60)), (1.0, 1e-90), (1.0, 1e90)],
)
def test_every_unit_is_proven_alike_and_claims_no_more(problem, unit, weight):
    optimum = brute_force(problem).energy
    for solve in (solve_pm_sdp, partial(prove, record=True)):
        scaled = in_unit(replace(problem, weights=weight * problem.weights), unit)
        proof = solve(scaled).certificate
        scale = unit * unit * weight
        share = check(scaled, proof) / scale / optimum
        assert 0.5 < share <= 1.0
        with pytest.raises(InputError, match="claims the bound"):
            check(scaled, replace(proof, bound=1.001 * scale * optimum))


def test_a_file_that_would_fill_the_memory_is_refused_unread(tmp_path):
    np.savez_compressed(tmp_path / "bomb.npz", array_F=np.zeros(MAX_BYTES // 8 + 1))
    with pytest.raises(InputError, match=r"bomb\.npz: .*more than"):
        Certificate.load(tmp_path / "bomb.npz")


@pytest.mark.parametrize("claim", [10**400, -(10**400)])
def test_claims_that_no_float_holds_are_refused(problem, proofs, claim):
    for certificate in proofs.values():
        with pytest.raises(InputError, match="which is no bound"):
            verify_certificate(problem.target, problem.source, replace(certificate, bound=claim))
