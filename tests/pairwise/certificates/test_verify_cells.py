"""Proofs by quasi-bounds: valid for every kind of problem, and refused where the cells do not tile the rotations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from data_tools.errors import InputError
from pairwise import Certificate, Problem, verify_certificate
from pairwise.branch_and_bound.cells import Cells
from pairwise.branch_and_bound.prove import prove
from pairwise.certificates.verify import proven_bound
from pairwise.certificates.verify_cells import cell_balls
from pairwise.problem.problem import energy_scale
from pairwise.status import Status
from tests.oracles import brute_force
from tests.rigid_problems import planted_cube, rigid_problem


@pytest.fixture(scope="module")
def problem() -> Problem:
    return Problem.from_user(*planted_cube(12, 0.1, 3))


@pytest.fixture(scope="module")
def certificate(problem) -> Certificate:
    proof = prove(problem, record=True)
    assert proof.status is Status.PROVEN_OPTIMAL
    assert proof.certificate.bound >= (1 - 2e-3) * proof.candidate.energy
    return proof.certificate


@pytest.mark.parametrize("seed", range(28))
def test_what_is_proven_is_below_the_optimum(seed) -> None:
    problem = rigid_problem(seed)
    proof = prove(problem, tol=1e-2, time_limit_s=0.3, record=True)
    bound = verify_certificate(problem.target, problem.source, proof.certificate, problem=problem)
    optimum, scale = brute_force(problem).energy, energy_scale(problem)
    assert bound <= optimum + 1e-12 * scale
    if proof.status is Status.PROVEN_OPTIMAL:
        assert bound >= 0.98 * optimum - 1e-8 * scale


@pytest.mark.parametrize("dim", [2, 3])
def test_the_verifier_finds_the_same_cells(dim) -> None:
    cells = Cells.whole(dim)
    for _ in range(8):
        cells = cells.split()
    for ours, theirs in zip(cell_balls(cells.faces, cells.depths, cells.paths, dim), cells.balls(), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_a_certificate_survives_its_file(problem, certificate, tmp_path) -> None:
    certificate.save(tmp_path / "proof.npz")
    again = Certificate.load(tmp_path / "proof.npz")
    bound = verify_certificate(problem.target, problem.source, again, problem=problem)
    assert bound == pytest.approx(certificate.bound, abs=1e-12)


def without(certificate: Certificate, kept: np.ndarray) -> dict[str, np.ndarray]:
    names = [f"proper_{name}" for name in ("faces", "depths", "paths", "evidence")]
    return {**certificate.arrays, **{name: certificate.arrays[name][kept] for name in names}}


def test_cells_that_do_not_tile_the_rotations_are_refused(problem, certificate) -> None:
    num = len(certificate.arrays["proper_faces"])
    everything = np.arange(num)
    for kept in (everything[1:], everything[:-1], np.append(everything, 0), everything[:0]):
        with pytest.raises(InputError, match="tile"):
            proven_bound(problem, "cells", without(certificate, kept))
    shuffled = np.random.default_rng(0).permutation(num)
    assert proven_bound(problem, "cells", without(certificate, shuffled)) == pytest.approx(certificate.bound)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [("faces", 4, "faces"), ("depths", 61, "depths"), ("paths", 2**40, "path"), ("evidence", 10**6, "evidence")],
)
def test_impossible_cells_are_refused(problem, certificate, name, value, message) -> None:
    changed = certificate.arrays[f"proper_{name}"].astype(np.int64)
    changed[0] = value
    with pytest.raises(InputError, match=message):
        proven_bound(problem, "cells", {**certificate.arrays, f"proper_{name}": changed})


def test_any_potentials_prove_what_is_true(problem, certificate) -> None:
    rng = np.random.default_rng(1)
    values = certificate.arrays["proper_potentials"]
    for noise in (1e-3, 1.0, 1e12):
        other = values + noise * rng.standard_normal(values.shape)
        arrays = {**certificate.arrays, "proper_potentials": other}
        assert proven_bound(problem, "cells", arrays) <= certificate.bound
        with pytest.raises(InputError, match="claims"):
            verify_certificate(problem.target, problem.source, replace(certificate, arrays=arrays))


def test_a_proof_for_rotations_is_none_for_reflections(problem, certificate) -> None:
    both = Problem.from_user(problem.target, problem.source, group="O")
    with pytest.raises(InputError, match="reflected"):
        proven_bound(both, "cells", certificate.arrays)
