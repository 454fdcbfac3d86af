"""Forged certificates for Hypothesis, and what the verifier says of them compared with brute force."""

import warnings
from dataclasses import replace
from functools import cache

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st
from hypothesis.extra import numpy as hn

from data_tools.errors import InputError
from pairwise import Problem, verify_certificate
from pairwise.branch_and_bound.prove import prove
from pairwise.certificates.certificate import build_problem, hash_problem, read_problem
from pairwise.relaxations import solve_pm_sdp
from tests.oracles import brute_force

#: What a bound may exceed the optimum by, as a share of the problem's scale.
TOL = 1e-9

#: How a change fails that an array's type or shape does not allow; the array then stays as it is.
NOT_FOR_THIS_TYPE = (TypeError, ValueError, IndexError, AttributeError, OverflowError)


def judge(problem, forged, states_problem):
    """Return "refused", "true" (the bound holds), or what is wrong."""
    stated = problem if states_problem else None
    try:
        bound = verify_certificate(problem.target, problem.source, forged, problem=stated)
        about = problem if states_problem else read_problem(problem.target, problem.source, forged)
    except InputError:
        return "refused"
    except Exception as error:
        return f"unclear error: {type(error).__name__}: {error}"
    unit, about = in_own_unit(about)
    squares = (about.target**2).sum() + (about.weights * (about.source**2).sum(axis=1)).sum()
    scale = float(squares + np.abs(about.constant_cost).max(initial=0.0))
    optimum = brute_force(about).energy
    if not np.ldexp(bound, -unit) <= optimum + TOL * scale:
        proven = f"{np.ldexp(bound, -unit):.12g}"
        return f"false: proves {proven} where the optimum is {optimum:.12g}, in units of 2^{unit}"
    return "true"


def in_own_unit(problem):
    """Return a power of two and the problem with energies in its unit, which brute force can add without overflow."""
    exponent = int(np.frexp(max(problem.weights.max(), np.abs(problem.constant_cost).max()))[1])
    return exponent, replace(
        problem,
        weights=np.ldexp(problem.weights, -exponent),
        constant_cost=np.ldexp(problem.constant_cost, -exponent),
    )


@cache
def honest():
    """Small problems of every kind and unit with their certificates."""
    rng = np.random.default_rng(20)
    mask = np.ones((5, 4), dtype=bool)
    mask[[0, 1, 4], [0, 0, 2]] = False
    narrow_mask = np.array([[1, 1, 1, 0], [1, 1, 1, 0], [0, 0, 1, 0], [1, 1, 1, 1]], dtype=bool)
    invariants = (rng.random((4, 2)), rng.random((4, 2)))
    cases = [
        (4, 4, 3, 1.0, {}),
        (5, 4, 3, 1e-6, {"group": "O", "allowed": mask}),
        (4, 3, 3, 1e6, {"weights": [0.5, 2.0, 1.0]}),
        (4, 4, 2, 30.0, {"group": "O", "invariants": invariants}),
        (4, 4, 3, 1.0, {"allowed": narrow_mask}),
    ]
    pairs = []
    for n, k, d, unit, options in cases:
        target = unit * (rng.random((n, d)) - 0.5)
        source = target[rng.permutation(n)[:k]] @ np.linalg.qr(rng.standard_normal((d, d)))[0]
        source += 0.1 * unit * rng.standard_normal((k, d))
        problem = Problem.from_user(target, source, **options)
        plain = [solve_pm_sdp(problem), prove(problem, tol=1e-2, record=True)]
        pairs += [(problem, result.certificate) for result in plain]
    points = rng.random((4, 5))
    blocks = Problem.from_user(points, points[::-1] + 0.1, rotation_pattern=[3, 2])
    pairs.append((blocks, solve_pm_sdp(blocks).certificate))
    return tuple(
        (problem, certificate) for problem, certificate in pairs if certificate is not None
    )


#: Numbers that sums and comparisons stumble over.
SPECIAL = [np.nan, np.inf, -np.inf, 0.0, -0.0, 1e308, -1e308, 1e200, 1e-320, -1e-200, 2.0**62]
FACTORS = [-1.0, 2.0, 0.5, 1e8, 1e-8, 1e160, 1e-160, 1e300, 0.0, 1.0 + 1e-12]
TYPES = ["f2", "f4", "f8", ">f8", "g", "i8", "u1", "c16", "?", "O", "U8", "m8[s]"]
#: Other objects in the place of an array, and other shapes of it.
MAKERS = [
    lambda a: a.tolist(),
    lambda a: np.ma.masked_array(a, mask=True),
    lambda a: np.matrix(a) if a.ndim <= 2 else a.view(np.recarray),
    lambda a: a[..., ::-1],
    lambda a: np.broadcast_to(a[:1], a.shape),
    lambda a: float(a.flat[0]),
    lambda a: None,
    lambda a: a[:-1],
    lambda a: a[None],
    lambda a: np.swapaxes(a, 0, -1),
    lambda a: np.zeros((0, 0, 0)),
]
generators = st.binary(min_size=8, max_size=8).map(lambda seed: np.random.default_rng([*seed]))


@st.composite
def forged(draw):
    """Return a problem and its certificate after one or a few changes, with a claim that nobody need believe."""
    problem, certificate = honest()[draw(st.integers(0, len(honest()) - 1))]
    arrays = dict(certificate.arrays)
    for _ in range(draw(st.sampled_from([1, 1, 2, 3]))):
        arrays = draw(changed(arrays))
    claims = [-1e300, -1.0, certificate.bound, 1.5 * certificate.bound]
    claim = draw(st.sampled_from(20 * claims + [1e6, np.nan, np.inf, "1", None, 1j]))
    kind = draw(st.sampled_from(50 * [certificate.kind] + ["pm-sdp", "cells", "exact", None, 3]))
    signature = certificate.problem_hash
    if draw(st.integers(0, 4)):
        try:
            signature = hash_problem(build_problem(problem.target, problem.source, arrays))
        except InputError:
            signature = draw(st.sampled_from([signature, None, "", b"x", 0]))
    return problem, replace(
        certificate, kind=kind, arrays=arrays, bound=claim, problem_hash=signature
    )


@st.composite
def changed(draw, arrays):
    """Return arrays of a certificate or a result of which one is changed, removed, added or borrowed."""
    how = draw(st.sampled_from([_shifted, _shifted, _cancelling, _cancelling, _other, _replaced]))
    names = sorted(n for n, a in arrays.items() if isinstance(a, np.ndarray) and a.size)
    dual = [n for n in names if n not in ("weights", "constant_cost", "pattern", "special_blocks")]
    assume(dual)
    name = draw(st.sampled_from(dual) | st.sampled_from(names))
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            return how(draw, arrays, name)
        except NOT_FOR_THIS_TYPE:
            return arrays


def _shifted(draw, arrays, name):
    """Add noise of any size, of square matrices mostly symmetric, or multiply."""
    values, rng = arrays[name], draw(generators)
    if not draw(st.integers(0, 3)):
        return {**arrays, name: values * draw(st.sampled_from(FACTORS))}
    size = 10.0 ** rng.uniform(-16, 16) * draw(st.sampled_from([1.0, float(np.abs(values).max())]))
    noise = size * rng.standard_normal(values.shape)
    if values.ndim >= 2 and values.shape[-1] == values.shape[-2] and draw(st.integers(0, 4)):
        noise = noise + np.swapaxes(noise, -1, -2)
        if draw(st.booleans()):
            noise = noise @ np.swapaxes(noise, -1, -2)
    return {**arrays, name: (values + noise).astype(values.dtype)}


def _cancelling(draw, arrays, name):
    """Add huge multipliers that cancel, and between them small ones that vanish in a sum of their type."""
    rng = draw(generators)
    kind = draw(st.sampled_from(["f2", "f4", "f8", "g"]))
    names = [n for n, a in arrays.items() if isinstance(a, np.ndarray) and a.dtype.kind == "f"]
    names = [n for n in names if arrays[n].ndim > 1 and len(arrays[n]) > 2 and arrays[n].size]
    name = draw(st.sampled_from([n for n in names if n != "constant_cost"]))
    values = arrays[name].astype(kind)
    size = float(np.abs(values).max()) * 10.0 ** rng.uniform(6, 16)
    shift = np.eye(*values[0].shape) if values.ndim == 3 else np.ones_like(values[0])
    lost = rng.uniform(-1, 1) * float(np.finfo(values.dtype).eps) * size
    values[0], values[-1] = values[0] + size * shift, values[-1] - size * shift
    values[1] = values[1] + lost * shift
    return {**arrays, name: values}


def _other(draw, arrays, name):
    """Give an array another type, shape or class, or one of its numbers another value."""
    values = arrays[name]
    change = draw(st.sampled_from(["type", "class", "number"]))
    if change == "type":
        return {**arrays, name: values.astype(draw(st.sampled_from(TYPES)))}
    if change == "class":
        return {**arrays, name: draw(st.sampled_from(MAKERS))(values)}
    values = values.copy()
    at = draw(st.integers(0, values.size - 1))
    values.flat[at] = draw(st.sampled_from([values.flat[at] + 1, *SPECIAL]))
    return {**arrays, name: values}


def _replaced(draw, arrays, name):
    """Remove an array, replace it by any, take one of another certificate, or add what a problem may have."""
    more = {
        "unmatched_costs": np.full(4, draw(st.sampled_from([0.0, -1e6, 1e-3]))),
        "max_unmatched": np.array(draw(st.sampled_from([0, 1, 5, -3, 2**62, 2.0]))),
        "impossible": np.array([[draw(st.integers(-2, 6)), draw(st.integers(-2, 6))]]),
        "reflected_paths": np.ones((4, 4), dtype=bool),
        "bound": np.array(1e9),
    }
    donor = honest()[draw(st.integers(0, len(honest()) - 1))][1].arrays
    borrowed = draw(st.sampled_from(sorted(donor)))
    any_array = draw(hn.arrays(hn.scalar_dtypes(), hn.array_shapes(max_dims=3, max_side=4)))
    added = draw(st.sampled_from(sorted(more)))
    without = {key: values for key, values in arrays.items() if key != name}
    choices = [{}, {name: any_array}, {borrowed: donor[borrowed]}, {added: more[added]}]
    found = draw(st.sampled_from(choices))
    return without if not found else {**arrays, **found}
