"""Object symmetry: symmetric and asymmetric components of bilateral shapes, and their Procrustes ANOVA."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collalign.analysis.procrustes import MAX_SUPERIMPOSITIONS, SETTLED, best_rotations, unit_size
from collalign.analysis.shape_tests import NUM_PERMUTATIONS, SEED, AnovaRow, Effects
from data_tools.arrays import FloatArray, IntArray, as_floats, read_only
from data_tools.errors import InputError
from data_tools.threads import one_blas_thread

#: Points of which a second direction is inverted by so large a part of the first are not mirrored but rotated.
_MOST_INVERTED = 0.5
#: The mirror plane is x = 0.
_MIRROR = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjectSymmetry:
    """Configurations with object symmetry, superimposed at unit centroid size; the mirror plane is x = 0.

    Arrays are read-only.

    Attributes
    ----------
    mean : ndarray, shape (k, 3)
        The symmetric mean.
    symmetric : ndarray, shape (N, k, 3)
        Mean of each configuration and its relabelled mirror image.
    asymmetric : ndarray, shape (N, k, 3)
        What each differs by from that.
    directional : ndarray, shape (k, 3)
        Mean of the asymmetric components.
    asymmetry, fluctuating : ndarray, shape (N,)
        Norm of each asymmetric component, and of what it differs by from the directional one.
    anova : tuple of AnovaRow
        ``individual``, ``side`` (directional asymmetry), ``individual:side`` (fluctuating asymmetry), with replicates
        ``residual``, and ``total``, over all configurations and their mirror images. Degrees of freedom are those of
        landmarks, ``plain_df`` those of configurations; semilandmarks have fewer.
    """

    mean: FloatArray
    symmetric: FloatArray
    asymmetric: FloatArray
    directional: FloatArray
    asymmetry: FloatArray
    fluctuating: FloatArray
    anova: tuple[AnovaRow, ...]


@one_blas_thread()
def object_symmetry(
    samples: ArrayLike,
    partner: ArrayLike,
    *,
    individuals: Sequence[str] | None = None,
    permutations: int = NUM_PERMUTATIONS,
    seed: int = SEED,
) -> ObjectSymmetry:
    """Split configurations of bilateral objects into symmetric and asymmetric components.

    Every configuration and its mirror image, in which the points of each pair have changed places, are superimposed
    on one mean, which is symmetric by that.

    Parameters
    ----------
    samples : array_like, shape (N, k, 3)
        Complete.
    partner : array_like of int, shape (k,)
        The point on the other side; a point of the midline is its own.
    individuals : sequence of str, length N, optional
        Whom each configuration belongs to, where some are replicates; ``""`` where unknown, which does not count in
        the ANOVA.
    permutations, seed : int
        Random exchanges of sides that test directional asymmetry, and the seed of their generator.

    Raises
    ------
    InputError
        If points are missing, ``partner`` is no pairing, no plane mirrors the points to their partners, or
        ``individuals`` names nobody.

    References
    ----------
    Mardia, Bookstein and Moreton, Statistical assessment of bilateral symmetry of shapes, Biometrika 87 (2000).
    Klingenberg, Barluenga and Meyer, Shape analysis of symmetric structures, Evolution 56 (2002): the components, the
    sums of squares and the degrees of freedom.

    Examples
    --------
    >>> skulls = np.load("landmarks.npy")  # (12, 8, 3): two points of the midline, three of each side
    >>> found = collalign.statistics.object_symmetry(skulls, [0, 1, 5, 6, 7, 2, 3, 4])
    >>> found.symmetric.shape, found.anova[0].effect
    ((12, 8, 3), 'individual')
    """
    shapes = unit_size(as_floats(samples, "samples", shape=(None, None, 3)))
    pairing = check_pairing(partner, shapes.shape[1])
    if len(shapes) < 2:
        raise InputError(
            f"samples: asymmetry is compared between at least two shapes, got {len(shapes)}"
        )
    mean, aligned = _superimposed(shapes, pairing)
    owners = (
        np.arange(len(shapes)).astype(str)
        if individuals is None
        else np.array(individuals, dtype=str)
    )
    if len(owners) != len(shapes):
        raise InputError(f"individuals: {len(owners)} names for {len(shapes)} shapes")
    known = np.asarray(owners != "")
    if not known.any():
        raise InputError(
            "individuals: nobody is named; leave them out where nothing was measured again"
        )
    symmetric = 0.5 * (aligned + mirror_image(aligned, pairing))
    asymmetric = aligned - symmetric
    directional = asymmetric.mean(axis=0)
    return ObjectSymmetry(
        mean=read_only(mean),
        symmetric=read_only(symmetric),
        asymmetric=read_only(asymmetric),
        directional=read_only(directional),
        asymmetry=read_only(np.linalg.norm(asymmetric, axis=(1, 2))),
        fluctuating=read_only(np.linalg.norm(asymmetric - directional, axis=(1, 2))),
        anova=_anova(
            symmetric[known],
            asymmetric[known],
            pairing,
            owners[known],
            lambda components, counts: exchange_test(components, counts, permutations, seed),
        ),
    )


def check_pairing(partner: ArrayLike, num: int) -> IntArray:
    """Return a pairing of ``num`` points as integers, shape (num,).

    Raises
    ------
    InputError
        If it is none: the partner of a partner is the point itself.
    """
    pairing = np.asarray(partner)
    whole = pairing.shape == (num,) and np.issubdtype(pairing.dtype, np.integer)
    if (
        not whole
        or not ((pairing >= 0) & (pairing < num)).all()
        or (pairing[pairing] != np.arange(num)).any()
    ):
        raise InputError(
            f"partner: expected {num} point numbers of which each is the partner of its partner"
        )
    return np.asarray(pairing, dtype=np.int64)


def mirror_image(points: FloatArray, partner: IntArray) -> FloatArray:
    """Return points mirrored at x = 0, with those of each pair exchanged, shape (..., k, 3)."""
    return np.asarray(points[..., partner, :] * _MIRROR)


def mirror_normal(points: FloatArray, partner: IntArray) -> FloatArray:
    """Return the normal of the plane that mirrors centred points, shape (k, 3), to their partners best, shape (3,).

    The products of points and partners are a symmetric matrix; the best reflection rotates around the direction of
    its only negative eigenvalue.

    Raises
    ------
    InputError
        If no reflection comes near: two eigenvalues are negative, and neither of them small.
    """
    values, vectors = np.linalg.eigh(points.T @ points[partner])
    if values[0] >= 0 or values[1] < _MOST_INVERTED * values[0]:
        raise InputError(
            "partner: these pairs are not mirror images of each other; are left and right mixed up?"
        )
    normal = vectors[:, 0]
    return np.asarray(normal * np.sign(normal[np.abs(normal).argmax()]))


def _superimposed(shapes: FloatArray, partner: IntArray) -> tuple[FloatArray, FloatArray]:
    """Superimpose centred shapes of unit size on their symmetric mean, again and again until it stands still."""
    normal = mirror_normal(shapes[0], partner)
    rest = np.linalg.svd(normal[None])[2][1:]
    start = shapes[0] @ np.vstack([normal, rest]).T
    mean = 0.5 * (start + mirror_image(start, partner))
    for _ in range(MAX_SUPERIMPOSITIONS):
        aligned = shapes @ np.swapaxes(best_rotations(mean, shapes), 1, 2)
        average = aligned.mean(axis=0)
        new = 0.5 * (average + mirror_image(average, partner))
        new /= np.linalg.norm(new)
        moved, mean = float(np.sum((new - mean) ** 2)), new
        if moved <= SETTLED:
            break
    return mean, shapes @ np.swapaxes(best_rotations(mean, shapes), 1, 2)


def _anova(
    symmetric: FloatArray,
    asymmetric: FloatArray,
    partner: IntArray,
    individuals: NDArray[np.str_],
    exchange: Callable[[FloatArray, IntArray], Effects],
) -> tuple[AnovaRow, ...]:
    """Klingenberg et al. 2002, table 2: sums over configurations and mirror images, two of each."""
    _, rows, counts = np.unique(individuals, return_inverse=True, return_counts=True)
    num, num_shapes = len(counts), len(symmetric)
    means = [means_of_rows(values, rows, counts) for values in (symmetric, asymmetric)]
    grand = [values.mean(axis=0) for values in (symmetric, asymmetric)]
    across = [
        2 * float(counts @ ((m - g) ** 2).sum(axis=(1, 2)))
        for m, g in zip(means, grand, strict=True)
    ]
    within = [
        2 * float(((v - m[rows]) ** 2).sum())
        for v, m in zip((symmetric, asymmetric), means, strict=True)
    ]
    side = 2 * num_shapes * float((grand[1] ** 2).sum())
    num_middle = int((partner == np.arange(len(partner))).sum())
    num_pairs = (len(partner) - num_middle) // 2
    df_symmetric, df_asymmetric = 3 * num_pairs + 2 * num_middle - 4, 3 * num_pairs + num_middle - 3
    interaction = across[1] / ((num - 1) * df_asymmetric) if num > 1 else float("nan")
    has_replicates = num_shapes > num
    df_residual = (num_shapes - num) * (df_symmetric + df_asymmetric)
    error = sum(within) / df_residual if has_replicates else float("nan")
    exchanged = exchange(means[1], counts)
    table = [
        AnovaRow(
            effect="individual",
            df=(num - 1) * df_symmetric,
            sum_of_squares=across[0],
            f=_ratio(across[0], (num - 1) * df_symmetric, interaction),
            plain_df=num - 1,
        ),
        AnovaRow(
            effect="side",
            df=df_asymmetric,
            sum_of_squares=side,
            f=_ratio(side, df_asymmetric, interaction),
            z=float(exchanged.z[0]),
            p=float(exchanged.p[0]),
            plain_df=1,
        ),
        AnovaRow(
            effect="individual:side",
            df=(num - 1) * df_asymmetric,
            sum_of_squares=across[1],
            f=_ratio(across[1], (num - 1) * df_asymmetric, error),
            plain_df=num - 1,
        ),
    ]
    if has_replicates:
        plain = 2 * (num_shapes - num)
        table.append(
            AnovaRow(effect="residual", df=df_residual, sum_of_squares=sum(within), plain_df=plain)
        )
    total = sum(row.sum_of_squares for row in table)
    df, plain = sum(row.df for row in table), 2 * num_shapes - 1
    return (*table, AnovaRow(effect="total", df=df, sum_of_squares=total, plain_df=plain))


def means_of_rows(values: FloatArray, rows: IntArray, counts: IntArray) -> FloatArray:
    """Return the means of values (N, ...) of which each belongs to a row, shape (n, ...); ``counts`` (n,) of each."""
    sums = np.zeros((len(counts), *values.shape[1:]))
    np.add.at(sums, rows, values)
    return np.asarray(sums / counts[:, None, None])


def _ratio(sum_of_squares: float, df: int, against: float) -> float:
    return sum_of_squares / df / against if df > 0 and against > 0 else float("nan")


def exchange_test(
    components: FloatArray, weights: FloatArray | IntArray, permutations: int, seed: int
) -> Effects:
    """Compare the mean asymmetry with that after random exchanges of the sides of individuals.

    Neither names nor the order of individuals decide which are exchanged: they are taken by the size of asymmetry.

    Parameters
    ----------
    components : ndarray, shape (n, k, 3)
        Asymmetry of each individual.
    weights : ndarray, shape (n,)
        Of each in the mean.
    permutations, seed : int
        As in :func:`object_symmetry`.
    """
    flat = components.reshape(len(components), -1)
    ranked = np.argsort(np.linalg.norm(flat, axis=1), kind="stable")
    flat, weights = flat[ranked], weights[ranked]
    gram = (weights[:, None] * weights) * (flat @ flat.T)
    signs = np.random.default_rng(seed).choice(
        [-1.0, 1.0], size=(permutations + 1, len(components))
    )
    signs[0] = 1.0
    return Effects.of(np.einsum("ei,ij,ej->e", signs, gram, signs)[:, None])
