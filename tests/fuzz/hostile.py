"""Forged certificates by the thousand: none may prove more than brute force finds, or end in an unclear error."""

import contextlib
import warnings
from dataclasses import replace
from functools import cache

import numpy as np

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


def certificate_endings(num, *, seed=0):
    """Forge ``num`` certificates of every kind and yield what the verifier says; the same seed forges the same."""
    victims = honest()
    for index in range(num):
        rng = np.random.default_rng((seed, index))
        problem, certificate = victims[index % len(victims)]
        forged = forge(problem, certificate, rng)
        yield (
            f"{seed}-{index} ({certificate.kind})",
            judge(problem, forged, bool(rng.random() < 0.5)),
        )


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


def forge(problem, certificate, rng):
    """Return a certificate after one or a few changes, with a claim that the verifier need not believe."""
    arrays = dict(certificate.arrays)
    kind = certificate.kind
    is_careful = rng.random() < 0.3
    for _ in range(1 if is_careful else int(rng.geometric(0.4))):
        with (
            warnings.catch_warnings(),
            np.errstate(all="ignore"),
            contextlib.suppress(*NOT_FOR_THIS_TYPE),
        ):
            warnings.simplefilter("ignore")
            arrays = (_cancelling if is_careful else drawn(CHANGES, rng))(arrays, rng)
    if not is_careful and rng.random() < 0.05:
        kind = drawn(["pm-sdp", "cells", "exact", None, 3, ["cells"]], rng)
    claims = [
        -1e300,
        -1.0,
        certificate.bound,
        certificate.bound * 1.5,
        1e6,
        np.nan,
        np.inf,
        "1",
        None,
        1j,
    ]
    claim = drawn(claims[:4] if rng.random() < 0.95 else claims, rng)
    signature = certificate.problem_hash
    if rng.random() < 0.7:
        with contextlib.suppress(InputError):
            signature = hash_problem(build_problem(problem.target, problem.source, arrays))
    elif rng.random() < 0.05:
        signature = drawn([None, "", b"x", 0], rng)
    return replace(certificate, kind=kind, arrays=arrays, bound=claim, problem_hash=signature)


def drawn(choices, rng):
    return choices[int(rng.integers(len(choices)))]


def _array_name(arrays, rng):
    """Return the name of an array, of one of the dual variables nine times out of ten."""
    names = sorted(
        n for n, a in arrays.items() if isinstance(n, str) and isinstance(a, np.ndarray) and a.size
    )
    dual = [
        name
        for name in names
        if name not in ("weights", "constant_cost", "pattern", "special_blocks")
    ]
    return str(drawn(dual if dual and rng.random() < 0.9 else names, rng)) if names else ""


def _on_one(change):
    def apply(arrays, rng):
        name = _array_name(arrays, rng)
        return {**arrays, name: change(arrays[name], rng)} if name else arrays

    return apply


def _other_type(values, rng):
    names = [
        "f2",
        "f4",
        "f8",
        ">f8",
        ">f4",
        "g",
        "i4",
        "i8",
        "u1",
        ">i8",
        "c16",
        "?",
        "O",
        "U8",
        "S4",
        "m8[s]",
    ]
    return values.astype(drawn(names, rng))


def _other_class(values, rng):
    makers = [
        lambda a: a.tolist(),
        lambda a: np.ma.masked_array(a, mask=True),
        lambda a: np.matrix(a) if a.ndim <= 2 else a.view(np.recarray),
        lambda a: a[..., ::-1],
        lambda a: np.asfortranarray(a),
        lambda a: np.broadcast_to(a[:1], a.shape),
        lambda a: float(a.flat[0]),
        lambda a: None,
        lambda a: "array",
        lambda a: {"F": a},
    ]
    return drawn(makers, rng)(values)


def _other_shape(values, rng):
    makers = [
        lambda a: a[:-1],
        lambda a: a[:0],
        lambda a: a[None],
        lambda a: a.ravel(),
        lambda a: np.concatenate([a, a]),
        lambda a: np.swapaxes(a, 0, -1),
        lambda a: np.zeros((0, 0, 0)),
        lambda a: a[..., :-1],
    ]
    return drawn(makers, rng)(values)


def _one_value(values, rng):
    special = [
        np.nan,
        np.inf,
        -np.inf,
        0.0,
        -0.0,
        1.0,
        -1.0,
        1e308,
        -1e308,
        1e200,
        1e100,
        1e-320,
        -1e-200,
        2**62,
        -(2**62),
    ]
    changed = values.copy()
    changed.flat[int(rng.integers(values.size))] = drawn(special, rng)
    return changed


def _shifted(values, rng):
    size = 10.0 ** rng.uniform(-16, 16) * (
        1.0 if rng.random() < 0.5 else float(np.abs(values).max())
    )
    noise = size * rng.standard_normal(values.shape)
    if values.ndim >= 2 and values.shape[-1] == values.shape[-2] and rng.random() < 0.8:
        noise = noise + np.swapaxes(noise, -1, -2)
        if rng.random() < 0.5:
            noise = noise @ np.swapaxes(noise, -1, -2)
    return (values + noise).astype(values.dtype)


def _scaled(values, rng):
    factors = [-1.0, 2.0, 0.5, 1e8, 1e-8, 1e160, 1e-160, 1e300, 0.0, 1.0 + 1e-12]
    return values * drawn(factors, rng)


def _flipped(values, rng):
    changed = values.copy()
    index = int(rng.integers(values.size))
    changed.flat[index] = (
        not changed.flat[index] if values.dtype == bool else changed.flat[index] + 1
    )
    return changed


def _cancelling(arrays, rng):
    """Add huge multipliers that cancel, and between them small ones that vanish in a sum of their type."""
    names = [
        n
        for n, a in arrays.items()
        if isinstance(a, np.ndarray) and a.dtype.kind == "f" and a.ndim > 1
    ]
    name = drawn(
        [n for n in names if arrays[n].size and len(arrays[n]) > 2 and n != "constant_cost"], rng
    )
    changed = arrays[name].astype(drawn(["f2", "f4", "f4", "f4", "f8", "f8", "f8", "g"], rng))
    size = float(np.abs(changed).max()) * 10.0 ** rng.uniform(6, 16)
    shift = np.eye(*changed[0].shape) if changed.ndim == 3 else np.ones_like(changed[0])
    lost = float(drawn([-1.0, 1.0], rng) * rng.random() * np.finfo(changed.dtype).eps) * size
    changed[0], changed[-1] = changed[0] + size * shift, changed[-1] - size * shift
    changed[1] = changed[1] + lost * shift
    return {**arrays, name: changed}


def _removed(arrays, rng):
    name = _array_name(arrays, rng)
    return {key: values for key, values in arrays.items() if key != name}


def _added(arrays, rng):
    k = 4
    names = [
        ("unmatched_costs", np.full(k, drawn([0.0, -1e6, 999_999.0, 1e-3], rng))),
        ("max_unmatched", np.array(drawn([0, 1, 4, 5, -3, 999_999, 2**62], rng))),
        ("max_unmatched", np.array(2.0)),
        ("impossible", np.array([[int(rng.integers(-2, 6)), int(rng.integers(-2, 6))]])),
        ("impossible", np.argwhere(np.ones((4, 4)))),
        ("reflected_paths", np.ones((4, 4), dtype=bool)),
        ("bound", np.array(1e9)),
        (7, np.zeros(3)),
    ]
    name, values = drawn(names, rng)
    return {**arrays, name: values}


def _borrowed(arrays, rng):
    """Take an array from a certificate of any problem and kind."""
    donor = drawn(honest(), rng)[1].arrays
    name = drawn(sorted(donor), rng)
    return {**arrays, name: donor[name]}


def _repacked(arrays, rng):
    """Store every array of floating-point numbers in one type."""
    kind = drawn(["f2", "f4", ">f8", "g"], rng)
    return {
        name: values.astype(kind)
        if isinstance(values, np.ndarray) and values.dtype.kind == "f"
        else values
        for name, values in arrays.items()
    }


CHANGES = (
    *map(_on_one, (_other_type, _other_class, _other_shape, _one_value, _scaled, _flipped)),
    *3 * [_on_one(_shifted)],
    *2 * [_cancelling],
    *(_removed, _added, _borrowed, _repacked),
)
