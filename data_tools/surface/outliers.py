"""What is out of place: vertices that slipped, which rule moments and distances, and shapes of odd size."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy

from data_tools.arrays import BoolArray, FloatArray, IntArray, read_only, sums_by_owner
from data_tools.notes import Note
from data_tools.options import CleaningOptions
from data_tools.surface.cleaning import clean
from data_tools.surface.shape import Shape
from data_tools.surface.topology import mesh_edges, vertex_components

#: Vertices are far where they lie at least this many times as far from the middle as any that is not. Chosen, as the
#: numbers below, on generated shapes with up to 2 % of such vertices.
FAR_RATIO = 2.0
#: Largest share of the vertices that may be far: more are a part of the shape.
MAX_FAR_SHARE = 0.02
#: Far vertices of a mesh that are connected, at most: the end of a bar has three corners or more.
MAX_FAR_CONNECTED = 2
#: Their neighbours lie within this share of the others' radius: the rim of a cone around its tip does not.
MAX_RING_SHARE = 0.5


class StrayTuning(NamedTuple):
    """Numbers by which stray points of a cloud are found.

    Chosen on 75 clouds of fish, chairs, guitars, guns and teeth, evenly or unevenly scanned, with 1 to 10 % of their
    points strewn over a box. Of 10 % strays in clouds that are evenly scanned 91 % are left out, and .02 % of the
    surface. So it is with planes, teddy bears, horses, skulls and birds, which were not looked at.
    """

    num_nearest: int = 6
    """Points hang together where each is among so many nearest of the other. So do those of a thinly scanned side; a
    stray has points of the surface as its nearest, but is not among theirs."""
    reach: float = 2.0
    """Strays hang together with few points, and their nearest reach so many times as far as the median point's."""
    off_plane: float = 0.2
    """They lie off the plane through twice as many neighbours, by more than this share of how far these are."""
    many_off: float = 0.3
    """Where fewer than this share of them do, they are points of a thinly scanned surface."""
    largest_share: float = 0.12
    """More are sparse parts of the cloud."""
    fewest_points: int = 500
    """Clouds of fewer points are sparse themselves."""


STRAYS = StrayTuning()
#: Scans of so many points have stray points left out: what lies off a scan hides from where it was seen.
FEWEST_OF_SCAN = 100


def without_outliers(
    shape: Shape,
    options: CleaningOptions | None = None,
    *,
    fewest_points: int = STRAYS.fewest_points,
) -> Shape:
    """Leave out vertices far from all others, and stray points near a cloud.

    The hole that vertices of a mesh leave is closed by its own corners.

    Parameters
    ----------
    shape : Shape
        A clean mesh or point cloud.
    options : CleaningOptions, optional
        What the rest is cleaned by.
    fewest_points : int
        Clouds of fewer points keep their stray points.

    Returns
    -------
    Shape
        The same object where there are none; otherwise with a note and ``source_indices``.
    """
    far, radius = _last_after_gap(shape.vertices)
    faces = shape.faces
    if far.any() and shape.is_mesh:
        far, nearest = _out_of_place(shape.vertices, faces, far, radius)
        faces = nearest[faces]
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    strays = np.zeros_like(far) if shape.is_mesh else _strays(shape.vertices, ~far, fewest_points)
    if not (far | strays).any():
        return shape
    kept = np.flatnonzero(~(far | strays))
    notes = []
    if num := int(far.sum()):
        times = float(_from_middle(shape.vertices)[far].max() / radius)
        points = "vertices" if shape.is_mesh else "points"
        notes.append(
            Note("far-points-left-out", values={"num": num, "points": points, "times": times})
        )
    if num := int(strays.sum()):
        notes.append(Note("stray-points-left-out", values={"num": num}))
    rest = Shape(
        name=shape.name,
        vertices=read_only(shape.vertices[kept]),
        faces=read_only((np.cumsum(~(far | strays)) - 1)[faces]),
        file=shape.file,
        notes=(*shape.notes, *notes),
        source_indices=read_only(shape.file_indices[kept]),
        file_size=shape.file_size or len(shape.vertices),
    )
    return clean(rest, options)


def _strays(points: FloatArray, kept: BoolArray, fewest_points: int) -> BoolArray:
    """Return which of the kept points of a cloud lie off its surface: few, whose nearest neighbours are far."""
    strays = np.zeros(len(points), dtype=np.bool_)
    if kept.sum() < fewest_points:
        return strays
    cloud = points[kept]
    tree = scipy.spatial.cKDTree(cloud)
    reaches, nearest = tree.query(cloud, k=STRAYS.num_nearest + 1)
    ends = np.repeat(np.arange(len(cloud)), STRAYS.num_nearest), nearest[:, 1:].ravel()
    among = scipy.sparse.coo_array(
        (np.ones(len(ends[0])), ends), shape=(len(cloud), len(cloud))
    ).tocsr()
    piece = scipy.sparse.csgraph.connected_components(among.multiply(among.T), directed=False)[1]
    alone = piece != np.bincount(piece).argmax()
    alone &= reaches[:, -1] > STRAYS.reach * np.median(reaches[:, -1])
    if 0.0 < alone.mean() <= STRAYS.largest_share:
        are_off = _off_plane(tree, cloud[alone]) > STRAYS.off_plane
        if are_off.mean() >= STRAYS.many_off:
            strays[kept] = alone
    return strays


def _off_plane(tree: scipy.spatial.cKDTree, places: FloatArray) -> FloatArray:
    """Return how far points (n, 3) of a cloud are from the plane through their neighbours, over how far these are."""
    reaches, nearest = tree.query(places, k=2 * STRAYS.num_nearest + 1)
    neighbours = tree.data[nearest[:, 1:]]
    middle = neighbours.mean(axis=1)
    arms = neighbours - middle[:, None]
    normals = np.linalg.eigh(np.swapaxes(arms, 1, 2) @ arms)[1][:, :, 0]
    return np.abs(((places - middle) * normals).sum(axis=1)) / reaches[:, -1]


def _from_middle(vertices: FloatArray) -> FloatArray:
    return np.linalg.norm(vertices - np.median(vertices, axis=0), axis=1)


def _last_after_gap(vertices: FloatArray) -> tuple[BoolArray, float]:
    """Return which few vertices come after a gap, sorted by distance from the middle, and the others' radius."""
    distances = _from_middle(vertices)
    num_last = int(MAX_FAR_SHARE * len(vertices))
    last = np.sort(np.partition(distances, -num_last - 1)[-num_last - 1 :])
    gaps = np.flatnonzero((last[1:] >= FAR_RATIO * last[:-1]) & (last[:-1] > 0))
    radius = float(last[gaps[0]] if len(gaps) else last[-1])
    return distances > radius, radius


def _out_of_place(
    vertices: FloatArray, faces: IntArray, far: BoolArray, radius: float
) -> tuple[BoolArray, IntArray]:
    """Return which far vertices of a mesh are no structure of it, and the vertex that each of these collapses to.

    More than two of them that are connected stay, as do those whose neighbours are spread over the shape: a bar may
    have vertices at its ends alone, a cone a fine rim and one tip.
    """
    edges = mesh_edges(faces)
    num, group = vertex_components(len(vertices), [edges[far[edges].all(axis=1)]])
    across = edges[far[edges].sum(axis=1) == 1]
    across = np.where(far[across[:, :1]], across, across[:, ::-1])  # from far to near
    of, near = group[across[:, 0]], across[:, 1]
    counts = np.bincount(of, minlength=num)
    sums = sums_by_owner(vertices[near], of, num)
    from_mean = np.linalg.norm(vertices[near] - (sums / np.maximum(counts, 1)[:, None])[of], axis=1)
    spread, target = np.zeros(num), np.zeros(num, dtype=np.int64)
    np.maximum.at(spread, of, from_mean)
    target[of] = near
    goes = (
        (counts > 0)
        & (np.bincount(group) <= MAX_FAR_CONNECTED)
        & (spread <= MAX_RING_SHARE * radius)
    )
    far = far & goes[group]
    return far, np.where(far, target[group], np.arange(len(vertices)))


#: Shapes so many times larger or smaller than the median one may be in another unit.
ODD_FACTOR = 8.0
#: By what one unit differs from another for which it is taken: millimetres, centimetres, metres, inches.
UNIT_FACTORS = (10.0, 100.0, 1000.0, 25.4)
#: Nearer to the median, shapes are odd behind a gap at least so wide, and as wide as the range of all others. Divided
#: by the factor they lie in that range, up to the slack. Chosen on 400 draws of 6 to 50 generated sizes.
_LEAST_GAP, _SLACK = 2.0, 1.25
#: Fewer others have no range.
_FEWEST_OTHERS = 5


def odd_ratios(sizes: Mapping[str, float]) -> dict[str, float]:
    """Return by what factor shapes differ from the median one, of those that may be in another unit.

    These differ by :data:`ODD_FACTOR` or more, or lie behind a wide gap and would be as large as the others in
    another unit.

    Parameters
    ----------
    sizes : mapping of str to float
        A length of each shape in the unit of its file.
    """
    middle = float(np.median(list(sizes.values()))) if sizes else 1.0
    ratios = {name: size / middle for name, size in sizes.items() if size > 0 and middle > 0}
    far = {name for name, ratio in ratios.items() if max(ratio, 1.0 / ratio) >= ODD_FACTOR}
    far |= _behind_a_gap({name: ratio for name, ratio in ratios.items() if name not in far})
    return {name: ratio for name, ratio in ratios.items() if name in far}


def _behind_a_gap(ratios: Mapping[str, float]) -> set[str]:
    """Return the smaller side of a gap in the sizes, if another unit brings it among the others."""
    names = sorted(ratios, key=ratios.__getitem__)
    for at in range(1, len(names)):
        below, above = names[:at], names[at:]
        few, others = (below, above) if len(below) < len(above) else (above, below)
        low, high = ratios[others[0]], ratios[others[-1]]
        gap = ratios[names[at]] / ratios[names[at - 1]]
        if len(others) < _FEWEST_OTHERS or gap < max(_LEAST_GAP, high / low):
            continue
        for factor in UNIT_FACTORS:
            right = factor if few is below else 1.0 / factor
            smallest, largest = right * ratios[few[0]], right * ratios[few[-1]]
            if low / _SLACK <= smallest and largest <= high * _SLACK:
                return set(few)
    return set()


class ApartTuning(NamedTuple):
    """Numbers by which sizes that are two or three times those of the others are found.

    Chosen on 300 draws each of 6 to 60 generated sizes of seven kinds, with six others held out.

    Beside a covariate, numbers were chosen on 200 draws of four curves of growth.
    """

    least: float = 1.6
    """Larger shapes are named from this times the median of the others."""
    gap: float = 0.75
    """The gap to the others is at least this part of their range of log sizes."""
    p: float = 0.01
    """Student's t of the nearest to the gap against the others, times the number of shapes."""
    largest_share: float = 1 / 8
    """More shapes are of another kind; one may always be named."""
    near: float = 1.1
    """Smaller shapes may be young. They are named only so near to the factor of a usual mistake."""
    num_beside: int = 2
    """Beside a covariate, sizes are compared with the median of so many with a little more of it, or less."""
    deviations: float = 4.0
    """They differ by so many deviations (by the median) of sizes from those on both sides."""
    correlation: float = 0.8
    """Sizes follow a covariate from this rank correlation."""


APART = ApartTuning()
#: Factors between 1.6 and the units that mistakes lead to: a diameter for a radius, inches for centimetres.
MISTAKEN_FACTORS = (2.0, 2.54)
_LEAST_DEVIATION = 0.02


def apart_ratios(sizes: Mapping[str, float]) -> dict[str, float]:
    """Return by what factor shapes differ from the others, of those that are about two or three times their size.

    Shapes of :func:`odd_ratios` neither count nor are named.

    Parameters
    ----------
    sizes : mapping of str to float
        A length of each shape in the unit of its file.
    """
    odd = odd_ratios(sizes)
    names = sorted(name for name, size in sizes.items() if size > 0 and name not in odd)
    logs, found = np.log([sizes[name] for name in names]), dict[str, float]()
    for sign in (1, -1):
        order = np.argsort(sign * logs, kind="stable")
        for num in range(max(1, int(APART.largest_share * len(names))), 0, -1):
            others, apart = sign * logs[order[:-num]], sign * logs[order[-num:]]
            if len(others) >= _FEWEST_OTHERS and _are_apart(apart, others, sign):
                ratios = np.exp(sign * (apart - np.median(others)))
                found |= {names[at]: float(r) for at, r in zip(order[-num:], ratios, strict=True)}
                break
    return found


def _are_apart(apart: FloatArray, others: FloatArray, sign: int) -> bool:
    """Return whether the largest of sorted log sizes, or of their negatives, are apart from the others."""
    beyond, num = apart - np.median(others), len(others)
    usual = np.abs(beyond[:, None] - np.log(MISTAKEN_FACTORS)).min(axis=1) <= np.log(APART.near)
    likely = usual.all() if sign < 0 else beyond[0] >= np.log(APART.least)
    if not likely or apart[0] - others[-1] < APART.gap * (others[-1] - others[0]):
        return False
    deviation = max(float(others.std(ddof=1)), _LEAST_DEVIATION) * np.sqrt(1.0 + 1.0 / num)
    tail = scipy.special.stdtr(num - 1, (others.mean() - apart[0]) / deviation)  # of Student's t
    return bool((num + len(apart)) * tail < APART.p)


def odd_for_covariate(sizes: FloatArray, covariate: FloatArray) -> dict[int, float] | None:
    """Return by what factor sizes differ from those of nearly the same covariate, of those that differ by far.

    Where sizes grow with a covariate, in whatever way, no shape is larger than those with somewhat more of it, or
    smaller than those with somewhat less. By how much it differs is told by these, or by a line through log sizes and
    the covariate or its logarithm (Theil 1950, Sen 1968), whichever fits best.

    Parameters
    ----------
    sizes : ndarray, shape (N,)
    covariate : ndarray, shape (N,)
        NaN where unknown.

    Returns
    -------
    dict of int to float, or None
        By position; None where sizes do not follow the covariate.
    """
    known = np.flatnonzero(np.isfinite(covariate) & (sizes > 0))
    values, logs = covariate[known], np.log(sizes[known])
    if len(known) <= _FEWEST_OTHERS or np.ptp(values) == 0 or np.ptp(logs) == 0:
        return None
    correlation = scipy.stats.spearmanr(values, logs).statistic
    if abs(correlation) < APART.correlation:
        return None
    above, rest = np.full((2, len(known)), -np.inf), np.empty(len(known))
    for at, value in enumerate(values):
        away, beside = np.sign(correlation) * (values - value), list[IntArray]()
        for side, sign in enumerate((1, -1)):
            others = np.flatnonzero((sign * away >= 0) & (np.arange(len(known)) != at))
            far = np.abs(away[others])
            near = others[far <= np.sort(far)[: APART.num_beside].max(initial=0.0)]
            if len(near) >= APART.num_beside:
                above[side, at] = sign * (logs[at] - np.median(logs[near]))
            beside.append(near)
        rest[at] = logs[at] - np.median(logs[np.concatenate(beside)])
    fits = [rest]
    for along in (values, np.log(values)) if values.min() > 0 else (values,):
        off = logs - scipy.stats.theilslopes(logs, along).slope * along
        fits.append(off - np.median(off))
    rest = min(fits, key=lambda one: float(np.median(np.abs(one))))
    deviation = float(scipy.stats.median_abs_deviation(rest, scale="normal"))
    limit = max(float(np.log(APART.least)), APART.deviations * deviation)
    odd = ((above[0] > 0) & (rest > limit)) | ((above[1] > 0) & (rest < -limit))
    return {int(known[at]): float(np.exp(rest[at])) for at in np.flatnonzero(odd)}
