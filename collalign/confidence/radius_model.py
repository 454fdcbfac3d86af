"""Error radii of carried landmarks: calibrated on the templates, each predicted from the others."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_tools.arrays import BoolArray, FloatArray

#: Share of landmarks that lie within their radius.
COVERAGE = 0.9
#: How much the spread of the templates counts against the landmark's error on other templates, and the powers of
#: what else foretells errors (``python -m experiments calibrate radii``).
_SPREAD_WEIGHT, _DISTANCE_POWER, _RESIDUAL_POWER = 1.5, 0.3, 0.1
#: Distances and residuals below these parts of the radius say no more.
_LEAST_DISTANCE, _LEAST_RESIDUAL = 1e-3, 2e-4
#: Residuals beyond the largest on templates are out of the calibrated range, though never those below this, in
#: radii. Variations below it are below those that radii of few templates were fitted to: errors are the hand's.
LEAST_RANGE = 0.05
#: What radii and ellipsoids of few templates follow says no more below these: hold, which has its own least, and
#: lengths in parts of the variation.
LEAST_SHOWN, LEAST_SHOWN_HELD = (0.0, 0.25, 0.01, 0.01), (0.02, 0.01, 0.01)
#: Of one, two and three templates: a factor, and powers of hold, slip, misfit and spread. ``python -m experiments
#: calibrate few_radii`` fits them, so that radii hold nine of ten errors of each kind.
OF_FEW = (
    (3.8, -0.45, 0.55, 0.67, 0.0),
    (2.05, -0.42, 0.66, 0.53, 0.02),
    (1.75, -0.35, 0.78, 0.41, 0.04),
)
#: The same of ellipsoids, with powers of held slip, misfit and spread. ``python -m experiments calibrate
#: ellipsoids`` fits them.
ELLIPSOIDS_OF_FEW = (
    (9.2, 0.42, 0.65, 0.0),
    (3.9, 0.64, 0.38, 0.095),
    (3.0, 0.74, 0.26, 0.13),
)
#: Fewest templates that anything can be calibrated on.
MIN_TEMPLATES = 1 + len(OF_FEW)


@dataclass(frozen=True, kw_only=True, eq=False)
class RadiusEvidence:
    """What a prediction shows of its own error, without knowing the answer.

    Attributes
    ----------
    spread : ndarray, shape (l,)
        Of what the templates say, see :func:`spread`.
    distance : float
        Of the specimen from its templates, see :func:`collalign.template_landmarks.carry.template_distance`.
    residual : ndarray, shape (l,)
        Distance of the registered mean from the specimen's surface at each landmark.
    unit : float
        Root mean square radius, in the unit of all of these.
    variation : float
        Root mean square distance of corresponding points of all shapes from their mean.
    hold : ndarray, shape (l,)
        How well the templates' surfaces determine the place of each landmark
        (:func:`collalign.template_landmarks.local_fit.holds`); the mean over the templates.
    slip, misfit : ndarray, shape (l,)
        Distance of where the map takes the landmark from where a rigid fit of its surroundings on a template does,
        and how well these fit (:func:`collalign.template_landmarks.local_fit.fit_surroundings`); means over the
        templates.
    held : ndarray, shape (l, 3, 3)
        Square root of the hold of the specimen's surface (:func:`collalign.template_landmarks.local_fit.holds`).
        Errors times it are of one size in all directions.
    held_slip : ndarray, shape (l,)
        Slip times it; the root mean square over the templates.
    """

    spread: FloatArray
    distance: float
    residual: FloatArray
    unit: float
    variation: float
    hold: FloatArray
    slip: FloatArray
    misfit: FloatArray
    held: FloatArray
    held_slip: FloatArray

    @classmethod
    def unknown(cls, num: int) -> RadiusEvidence:
        """Return what is shown of ``num`` landmarks that nothing predicts."""
        nothing = np.full(num, np.nan)
        return cls(
            spread=nothing,
            distance=0.0,
            residual=nothing,
            unit=1.0,
            variation=0.0,
            hold=nothing,
            slip=nothing,
            misfit=nothing,
            held=np.full((num, 3, 3), np.nan),
            held_slip=nothing,
        )

    def expected(self, landmark_error: FloatArray) -> FloatArray:
        """Return a number in proportion to the error to expect, given each landmark's error elsewhere, shape (l,)."""
        distance = max(self.distance / self.unit, _LEAST_DISTANCE)
        residual = np.maximum(self.residual / self.unit, _LEAST_RESIDUAL)
        known = np.hypot(landmark_error, _SPREAD_WEIGHT * self.spread)
        return np.asarray(known * distance**_DISTANCE_POWER * residual**_RESIDUAL_POWER)

    def of_few(self, num_templates: int) -> FloatArray:
        """Return the radii of the landmarks of one to three templates, shape (l,)."""
        sizes = sizes_of_few(self.shown(), LEAST_SHOWN, OF_FEW[num_templates - 1])
        return self.least_variation() * sizes

    def shown(self) -> FloatArray:
        """Return what radii of few templates follow, shape (l, 4).

        Columns are hold, and slip, misfit and spread in parts of the variation: a class of small variation has small
        ones, however well it is registered.
        """
        lengths = (self.slip, self.misfit, self.spread)
        return np.column_stack([self.hold, *(one / self.least_variation() for one in lengths)])

    def shown_held(self) -> FloatArray:
        """Return what ellipsoids of few templates follow, shape (l, 3).

        Columns are held slip, misfit and spread in parts of the variation.
        """
        return np.column_stack([self.held_slip, self.misfit, self.spread]) / self.least_variation()

    def scales_of_few(self, num_templates: int) -> FloatArray:
        """Return what nine of ten errors of one to three templates are below, times the root of hold, shape (l,)."""
        table = ELLIPSOIDS_OF_FEW[num_templates - 1]
        return self.least_variation() * sizes_of_few(self.shown_held(), LEAST_SHOWN_HELD, table)

    def held_errors(self, errors: FloatArray) -> FloatArray:
        """Return the sizes (l,) of errors (l, 3) where each direction counts as far as the surface holds it."""
        return np.asarray(np.linalg.norm(np.einsum("lij,lj->li", self.held, errors), axis=1))

    def least_variation(self) -> float:
        """Return the variation, at least the least that radii of few templates were fitted to."""
        return max(self.variation, LEAST_RANGE * self.unit)


def sizes_of_few(shown: FloatArray, least: Sequence[float], table: Sequence[float]) -> FloatArray:
    """Return a factor times powers of what is shown, (l, n), at least the least; shape (l,).

    Parameters
    ----------
    shown : ndarray, shape (l, n)
    least : sequence of float, length n
    table : sequence of float, length 1 + n
        The factor and the powers.
    """
    factor, *powers = table
    return np.asarray(factor * np.prod(np.maximum(shown, least) ** np.array(powers), axis=1))


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """What the templates say about errors of carried landmarks.

    Attributes
    ----------
    landmark_error : ndarray, shape (l,)
        Root mean square error of each landmark when templates are predicted from each other.
    factor : float
        A radius is so many times the expected error; NaN where there are too few templates.
    num_templates : int
    most_residual : float
        Largest residual at any landmark, in radii: nothing is known of errors where it is larger.
    """

    landmark_error: FloatArray
    factor: float
    num_templates: int
    most_residual: float


def calibrate(errors: FloatArray, evidence: Sequence[RadiusEvidence]) -> Calibration:
    """Learn radii from templates that were left out in turn.

    A landmark's error on a specimen is expected to be the larger, the larger it is on the other templates, the less
    the templates agree there, the less the specimen is like them, and the worse the registration fits there. The
    factor is the split-conformal quantile of error over expected error, where each error is expected without itself.

    Parameters
    ----------
    errors : ndarray, shape (t, l)
        Of each landmark on each template, predicted from the others; NaN where unknown.
    evidence : sequence of RadiusEvidence, length t
        Of those predictions.

    References
    ----------
    Lei, G'Sell, Rinaldo, Tibshirani and Wasserman, Distribution-free predictive inference for regression, JASA 113
    (2018), section 5.2 (locally weighted conformal inference). The scores of one specimen depend on each other, and
    specimens of another kind than the templates are not covered.
    """
    landmark_error, num = _rms(errors), len(errors)
    if num < MIN_TEMPLATES:
        nothing = math.nan
        return Calibration(
            landmark_error=landmark_error, factor=nothing, num_templates=num, most_residual=nothing
        )
    others = np.stack([_rms(np.delete(errors, at, axis=0)) for at in range(len(errors))])
    expected = [one.expected(without) for one, without in zip(evidence, others, strict=True)]
    scores = errors / np.array(expected)
    scores = np.sort(scores[np.isfinite(scores)])
    rank = math.ceil((len(scores) + 1) * COVERAGE)
    factor = float(scores[rank - 1]) if rank <= len(scores) else math.nan
    seen = np.concatenate([one.residual / one.unit for one in evidence])
    most = float(np.nanmax(seen)) if np.isfinite(seen).any() else math.nan
    return Calibration(
        landmark_error=landmark_error, factor=factor, num_templates=num, most_residual=most
    )


def beyond_range(calibration: Calibration, evidence: RadiusEvidence) -> BoolArray:
    """Return where the surface fits worse than on any template, so that no radius can be trusted, shape (l,).

    Without a calibration nothing is.
    """
    if math.isnan(calibration.most_residual):
        return np.zeros(len(evidence.residual), dtype=bool)
    limit = max(calibration.most_residual, LEAST_RANGE)
    return np.asarray(evidence.residual / evidence.unit > limit)


def radii(calibration: Calibration, evidence: RadiusEvidence) -> FloatArray:
    """Return the radius of each landmark on a specimen, shape (l,); NaN where there is no template.

    Of one to three templates, too few to calibrate on, they follow the surface around each landmark, as errors did on
    other collections.
    """
    if 0 < calibration.num_templates < MIN_TEMPLATES:
        return evidence.of_few(calibration.num_templates)
    return np.asarray(calibration.factor * evidence.expected(calibration.landmark_error))


def ellipsoids(calibration: Calibration, evidence: RadiusEvidence) -> FloatArray:
    """Return the semi-axes of the ellipsoid of each landmark on a specimen, longest first, shape (l, 3, 3).

    Rows are vectors: along the direction in which the surface holds the landmark least, across it, and about along
    the normal. NaN where there is no radius.

    Parameters
    ----------
    calibration : Calibration
        On errors of :meth:`RadiusEvidence.held_errors`.
    evidence : RadiusEvidence
    """
    if 0 < calibration.num_templates < MIN_TEMPLATES:
        scales = evidence.scales_of_few(calibration.num_templates)
    else:
        scales = calibration.factor * evidence.expected(calibration.landmark_error)
    roots, axes = np.linalg.eigh(evidence.held)
    return np.asarray(np.swapaxes(axes, 1, 2) * (scales[:, None] / roots)[..., None])


def spread(said: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the weighted standard deviation of what templates say about each landmark, shape (l,).

    Parameters
    ----------
    said : ndarray, shape (t, l, 3)
        NaN where a template says nothing.
    weights : ndarray, shape (t, l)
        Zero there; they sum to one for each landmark that any template knows.
    """
    filled = np.where(weights[..., None] > 0, said, 0.0)
    mean = (weights[..., None] * filled).sum(axis=0)
    squares = ((filled - mean) ** 2).sum(axis=2)
    return np.asarray(np.sqrt((weights * squares).sum(axis=0)))


def _rms(errors: FloatArray) -> FloatArray:
    """Root mean square over the rows that are known, shape (l,); NaN where none is."""
    known = np.isfinite(errors)
    counts = known.sum(axis=0)
    total = np.where(known, errors**2, 0.0).sum(axis=0)
    return np.asarray(np.sqrt(np.where(counts > 0, total / np.maximum(counts, 1), np.nan)))
