"""What a certificate states, field by field: read as strictly as what a caller gives, and hashed as a whole."""

from dataclasses import replace

import numpy as np
import pytest

from data_tools.errors import InputError
from pairwise import Problem
from pairwise.certificates.certificate import (
    LARGEST_VALUE,
    CertificateArrays,
    build_problem,
    hash_problem,
    in_unit,
    problem_arrays,
)
from pairwise.rotation_pattern import RotationPattern


@pytest.fixture
def problem(rng):
    return Problem.from_user(rng.random((5, 3)), rng.random((4, 3)), weights=[1.0, 2.0, 0.5, 0.0])


def built(problem, **arrays):
    return build_problem(problem.target, problem.source, {**problem_arrays(problem), **arrays})


def test_a_problem_survives_its_arrays(problem):
    again = build_problem(problem.target, problem.source, problem_arrays(problem))
    assert hash_problem(again) == hash_problem(problem)


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("weights", np.array([1.0, 1.0, 1.0, -1e-9]), "weights must not be negative"),
        ("weights", np.zeros(4), "nor all zero"),
        (
            "weights",
            np.array([1.0, 1.0, 1.0, np.nan]),
            "weights contains values that are not finite",
        ),
        ("weights", np.ones(5), r"weights has shape \(5,\), expected \(4\)"),
        ("weights", np.ones(4, dtype=np.int64), "weights has the wrong type"),
        ("candidates", np.zeros((5, 4), dtype=bool), "no injective map"),
        ("candidates", np.ones((5, 4)), "candidates has the wrong type"),
        ("special_blocks", np.array([[0, 2]]), r"has \[0, 2\], which is no block"),
        ("special_blocks", np.array([[-1, 3]]), "outside"),
        ("special_blocks", np.array([[0, 4]]), "outside"),
        ("special_blocks", np.array([[0, 3], [1, 3]]), "no block"),
        ("special_blocks", np.array([[0, 3], [0, 3]]), r"has \[0, 3\], which is no block"),
        ("special_blocks", np.array([[0, 3], [2, 2]]), r"has \[2, 2\]"),
    ],
)
def test_fields_are_refused_by_name(problem, name, values, message):
    with pytest.raises(InputError, match=message):
        built(problem, **{name: values})


def test_singular_patterns_are_refused(problem):
    pattern = np.array([[1, 1, 1], [0, 0, 1], [0, 0, 1]], dtype=bool)
    with pytest.raises(InputError, match="singular"):
        built(problem, pattern=pattern, special_blocks=np.zeros((0, 2), dtype=np.int64))


def test_the_hash_sees_every_field(problem):
    allowed, cost = problem.allowed.copy(), problem.constant_cost.copy()
    allowed[0, 0], cost[0, 0] = False, 1e-300
    others = [
        replace(problem, target=problem.target + 1e-15),
        replace(problem, source=problem.source + 1e-15),
        replace(problem, weights=problem.weights + 1e-15),
        replace(problem, allowed=allowed),
        replace(problem, constant_cost=cost),
        replace(problem, pattern=RotationPattern(problem.pattern.mask)),
        replace(
            problem, pattern=RotationPattern(np.eye(3, dtype=bool), problem.pattern.special_blocks)
        ),
    ]
    assert len({hash_problem(one) for one in [problem, *others]}) == 1 + len(others)


def test_numbers_come_in_the_unit_and_not_beyond_its_range():
    values = np.array([3.0, -5.0], dtype=">f4")
    given = CertificateArrays({"F": values, "i": np.array([0, 2], dtype=np.uint8)}, exponent=2)
    found = given.floats("F", (2,))
    assert found.dtype == np.dtype("=f8")
    assert found.tolist() == [0.75, -1.25]
    with pytest.raises(InputError, match="does not have: i"):
        given.refuse_rest("cells")
    assert given.indices("i", (2,), upper=3).dtype == np.int64
    given.refuse_rest("cells")
    with pytest.raises(InputError, match="outside"):
        given.indices("i", (2,), upper=2)
    for wrong in (np.array([0, -1]), np.array([3])):
        with pytest.raises(InputError, match="outside"):
            CertificateArrays({"i": wrong}).indices("i", (None,), upper=3)
    with pytest.raises(InputError, match="too large"):
        in_unit(np.array([2.0 * LARGEST_VALUE]), 0, "x")
    with pytest.raises(InputError, match="too large"):
        CertificateArrays({"F": np.array([1e50])}, exponent=-400).floats("F", (1,))
    for bad in (np.nan, np.inf):
        with pytest.raises(InputError, match="not finite"):
            CertificateArrays({"F": np.array([bad])}, exponent=0).floats("F", (1,))
    assert in_unit(np.array([1e-300]), 900, "x").tolist() == [0.0]
