"""The portfolio: many starts, distinct candidates refined and judged, and how far the best can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from collalign.confidence.map_model import (
    LEAST_AGREEMENT,
    NEAR,
    Evidence,
    map_probability,
    map_terms,
    point_probability,
)
from collalign.nonrigid.functional_map import (
    SMOOTHNESS,
    FunctionalMap,
    HarmonicRefiner,
    mutual_nearest_rows,
)
from collalign.nonrigid.map_evidence import MIXED_ORIENTATION, limb_gap, measure_evidence
from collalign.nonrigid.map_options import TUNED, NonrigidOptions
from collalign.nonrigid.map_starts import (
    ShellRefiner,
    candidate_mask,
    sign_starts,
    tip_starts,
    wave_gaps,
)
from collalign.nonrigid.pose_maps import (
    NUM_FUNCTIONS,
    NUM_POINTS,
    PoseMapper,
    axis_poses,
    first_samples,
    sampled_surface,
)
from collalign.nonrigid.refine import Refiner, without_torn_ends
from collalign.nonrigid.spectral_shape import SpectralShape
from data_tools.arrays import FloatArray, IntArray
from pairwise.local_search import LocalMinima

#: Origin of maps that only poses lead to, and of those that matched tips do.
FROM_POSES, FROM_TIPS = "poses", "tips"
#: Weights of the Dirichlet energy in the last iterations, on all samples.
SETTLING = (SMOOTHNESS,) * 3
#: The same on the way from a rough start.
ANNEALED = tuple(np.geomspace(1e-2, SMOOTHNESS, 8).tolist())

#: Candidates less than this worse in score than the best one where surfaces are laid onto each other at few samples
#: are laid at all samples, and so many at most: 5 of 21 on 16 pairs of bodies and animals, with the same choices.
LAID_LEAD, MOST_LAID = 1.0, 10
#: Surfaces of so many samples are laid at all of them at once.
MOST_FEW = 400
#: A map from within that is stated this or more needs no other starts. Of 30 pairs of SCAPE and 8
#: of bipeds one gets better by others, which is stated .91.
SURE_FROM_WITHIN = 0.95


@dataclass(frozen=True, kw_only=True, eq=False)
class Refined:
    """A refined map of dense samples with its evidence."""

    functional_map: FunctionalMap
    evidence: Evidence
    origin: str

    @property
    def score(self) -> float:
        """The lower the better; maps that only poses lead to have a handicap."""
        return self.evidence.score + (TUNED.posed_handicap if self.origin == FROM_POSES else 0.0)


class Layer:
    """Lays two meshes onto each other by candidate maps, prepared once for all of them.

    Parameters
    ----------
    target, source : SpectralShape
    options : NonrigidOptions
    """

    def __init__(
        self, target: SpectralShape, source: SpectralShape, options: NonrigidOptions
    ) -> None:
        self.mapper = PoseMapper(sampled_surface(target), sampled_surface(source))
        self._shells, self._options = ShellRefiner(target, source), options

    def laid(self, coarse: Refined) -> Refined:
        """Return what a map leads to on all samples where the surfaces are laid onto each other, smooth both ways."""
        options = self._options
        target, source = self.mapper.target.spectral, self.mapper.source.spectral
        maps = self._shells.refine(
            *_at_all_samples(target, source, coarse), chirality=chirality_of(coarse, options)
        )
        found = HarmonicRefiner(target, source).refine(*maps, SETTLING)
        settled_map = with_pose_evidence(
            self.mapper, refined_with_evidence(target, source, found, coarse.origin), options
        )
        limbs = limb_gap(
            self._shells.target,
            self._shells.source,
            found,
            chirality=chirality_of(settled_map, options),
        )
        return replace(settled_map, evidence=replace(settled_map.evidence, limbs=limbs))


def find_candidates(
    target: SpectralShape, source: SpectralShape, screened: list[Refined], options: NonrigidOptions
) -> list[Refined]:
    """Return distinct refined candidates, best evidence first.

    Starts are screened with few samples and functions. Surfaces are laid onto each other by the best, at few samples
    first; those that can still win are refined with all. Those from within, ``screened``, come first.
    If they leave the map in doubt, matched tips and poses start others, where there are normals: shapes of a class
    may look alike where their insides differ.
    """
    coarse = _likely(screened, options)
    if not has_normals(target, source):
        return distinct_maps([settled(target, source, one) for one in coarse])
    laying = _Laying(target, source, options)
    found = laying.leading(coarse)
    if options.orientation == "preserving" and _is_sure(target, found, options):
        return found
    for started in (
        screened_from_tips(laying.mapper, target, source, options),
        screened_from_poses(laying.mapper, options),
    ):
        coarse += _others(_likely(started, options), coarse)
    return laying.leading(coarse)


class _Laying:
    """Lays two surfaces onto each other by candidates: by all at few samples, and in full by those that can win.

    Surfaces of few samples, and those of which both orientations are asked for, are laid in full by all.
    """

    def __init__(
        self, target: SpectralShape, source: SpectralShape, options: NonrigidOptions
    ) -> None:
        self._every = Layer(target, source, options)
        self._few: Layer | None = None
        self._scores: dict[Refined, float] = {}
        self._found: dict[Refined, Refined] = {}
        if options.orientation == "preserving" and len(target.dense) > MOST_FEW:
            to, of = (one.coarse(NUM_POINTS, NUM_FUNCTIONS) for one in (target, source))
            self._few = Layer(to, of, options)

    @property
    def mapper(self) -> PoseMapper:
        """Between the dense samples."""
        return self._every.mapper

    def leading(self, coarse: list[Refined]) -> list[Refined]:
        """Return the distinct maps of candidates that can win, best evidence first."""
        kept = coarse if self._few is None else self._near_best(self._few, coarse)
        self._found |= {one: self._every.laid(one) for one in kept if one not in self._found}
        return distinct_maps([self._found[one] for one in kept])

    def _near_best(self, few: Layer, coarse: list[Refined]) -> list[Refined]:
        self._scores |= {one: few.laid(one).score for one in coarse if one not in self._scores}
        ranked = sorted(coarse, key=lambda one: self._scores[one])
        most = self._scores[ranked[0]] + LAID_LEAD
        return [one for one in ranked[:MOST_LAID] if self._scores[one] < most]


def _is_sure(target: SpectralShape, found: list[Refined], options: NonrigidOptions) -> bool:
    """Return whether the likeliest candidate from within needs no other starts."""
    number = likeliest(target, found, options)
    return whole_trust(target, found, number) >= SURE_FROM_WITHIN


def candidates_from(
    target: SpectralShape, source: SpectralShape, poses: FloatArray, options: NonrigidOptions
) -> list[Refined]:
    """Return distinct candidates that poses (m, 3, 3) of two meshes start, best evidence first."""
    layer = Layer(target, source, options)
    few = at_few_samples(layer.mapper)
    coarse = [
        refined_with_evidence(
            few.target.spectral, few.source.spectral, few.map_from(pose), FROM_POSES
        )
        for pose in poses
    ]
    return distinct_maps([layer.laid(one) for one in coarse])


def with_others_from_poses(
    mapper: PoseMapper, own: Refined, options: NonrigidOptions
) -> list[Refined]:
    """Return a candidate, and behind it other maps that poses start, all with what their poses leave."""
    target, source = mapper.target.spectral, mapper.source.spectral
    others = [settled(target, source, one) for one in screened_from_poses(mapper, options)]
    others = distinct_maps(
        [with_pose_evidence(mapper, one, options) for one in _others(others, [own])]
    )
    return [with_pose_evidence(mapper, own, options), *others]


def screened_from_within(
    target: SpectralShape, source: SpectralShape, options: NonrigidOptions
) -> list[Refined]:
    """Return at most ``options.num_candidates`` maps at few samples, by no pose, best evidence first."""
    samples = source.samples[: min(TUNED.num_source, len(target.samples))]
    allowed = candidate_mask(wave_gaps(target, source, samples), TUNED.wave_share)
    starts = sign_starts(target, source, samples, allowed)
    screen = Refiner(
        target,
        source,
        first=18,
        last=TUNED.screen_last,
        factor=1.35,
        num_dense=TUNED.num_screen_samples,
    )
    screened: list[Refined] = []
    for i in distinct_starts(starts, TUNED.num_screened):
        maps = start_maps(screen, starts.rotations[i], has_normals=has_normals(target, source))
        screened += [
            refined_with_evidence(target, source, refined, str(starts.origins[i]))
            for refined in maps
        ]
    return of_both_orientations(distinct_maps(screened), options.num_candidates)


def screened_from_tips(
    mapper: PoseMapper, target: SpectralShape, source: SpectralShape, options: NonrigidOptions
) -> list[Refined]:
    """Return maps at few samples that matched tips of two meshes start, best evidence first."""
    few = at_few_samples(mapper)
    harmonic = HarmonicRefiner(few.target.spectral, few.source.spectral)
    starts = tip_starts(
        target, source, len(few.target.points), mirrored=options.orientation == "any"
    )
    maps = [harmonic.refine(*start, ANNEALED) for start in starts]
    return _best_posed(few, maps, options, FROM_TIPS)[: TUNED.num_tipped]


def screened_from_poses(mapper: PoseMapper, options: NonrigidOptions) -> list[Refined]:
    """Return maps at few samples that poses start, those of :func:`posed_candidates` and smooth ones."""
    few = at_few_samples(mapper)
    posed = posed_candidates(few, options)
    return posed + _others(smooth_candidates(few, options), posed)


def posed_candidates(few: PoseMapper, options: NonrigidOptions) -> list[Refined]:
    """Return maps at few samples that start from the axes' poses and from signs, best evidence first.

    Parameters
    ----------
    few : PoseMapper
        Of both surfaces at few samples.
    options : NonrigidOptions
        Whether maps that swap left and right are asked for.
    """
    maps = few.maps_from_signs()
    for start in axis_poses(few.target, few.source, mirrored=options.orientation == "any"):
        plain = few.map_from(start)
        maps += [plain, few.oriented(plain, preserving=bool(np.linalg.det(start) > 0))]
    return _best_posed(few, maps, options)[: TUNED.num_posed]


def smooth_candidates(few: PoseMapper, options: NonrigidOptions) -> list[Refined]:
    """Return maps at few samples that are smooth from the start, by the axes' poses, best evidence first."""
    harmonic = HarmonicRefiner(few.target.spectral, few.source.spectral)
    poses = axis_poses(few.target, few.source, mirrored=options.orientation == "any")
    return _best_posed(
        few, [harmonic.refine(*few.closest_points(pose), ANNEALED) for pose in poses], options
    )[: TUNED.num_posed]


def at_few_samples(mapper: PoseMapper) -> PoseMapper:
    """Return the mapper of the surfaces' first samples and lowest functions."""
    return PoseMapper(
        *(first_samples(one, NUM_POINTS, NUM_FUNCTIONS) for one in (mapper.target, mapper.source))
    )


def _best_posed(
    few: PoseMapper, maps: list[FunctionalMap], options: NonrigidOptions, origin: str = FROM_POSES
) -> list[Refined]:
    target, source = few.target.spectral, few.source.spectral
    found = [
        with_pose_evidence(few, refined_with_evidence(target, source, one, origin), options)
        for one in maps
    ]
    if options.orientation == "preserving":
        found = [candidate for candidate in found if candidate.evidence.orientation > 0]
    return distinct_maps(found)


def with_pose_evidence(mapper: PoseMapper, candidate: Refined, options: NonrigidOptions) -> Refined:
    """Return a candidate whose evidence knows what the pose that it asks for leaves between the surfaces."""
    rotation = mapper.rotation_of(
        candidate.functional_map, chirality=chirality_of(candidate, options)
    )
    normals = mapper.normal_gap(candidate.functional_map, rotation)
    return replace(
        candidate,
        evidence=replace(candidate.evidence, normals=normals, surface=mapper.surface_gap(rotation)),
    )


def mended(
    target: SpectralShape, source: SpectralShape, torn: Refined, options: NonrigidOptions
) -> Refined:
    """Return a candidate found again from its largest piece each way, if it is torn and that is judged no worse."""
    if not has_normals(target, source):
        return torn
    maps = without_torn_ends(target, source, torn.functional_map)
    if min(maps[0].min(), maps[1].min()) >= 0:
        return torn
    coarse = replace(
        torn, functional_map=HarmonicRefiner(target, source).refine(*maps, ANNEALED[:1])
    )
    return min(torn, Layer(target, source, options).laid(coarse), key=lambda one: one.score)


def sharpened(target: SpectralShape, source: SpectralShape, chosen: Refined) -> Refined:
    """Return a candidate refined in all functions alike, which near-isometric surfaces allow, if no sample goes far.

    Embeddings and space count what is coarse; ZoomOut counts what is fine as much, and turns limbs of other surfaces.
    """
    found = chosen.functional_map
    zoomout = Refiner(target, source, first=30, factor=1.2).zoomout
    maps = zoomout.refine(found.map_target_source, found.map_source_target)
    sharp = HarmonicRefiner(target, source).refine(
        maps.map_target_source, maps.map_source_target, SETTLING
    )
    places = target.vertices[target.dense] / target.area**0.5
    gone = np.linalg.norm(places[sharp.map_target_source] - places[found.map_target_source], axis=1)
    return chosen if (gone > NEAR).any() else replace(chosen, functional_map=sharp)


def settled(target: SpectralShape, source: SpectralShape, coarse: Refined) -> Refined:
    """Return what a candidate map leads to with all samples, smooth both ways, by the functions of shapes alone."""
    maps = _at_all_samples(target, source, coarse)
    return refined_with_evidence(
        target, source, HarmonicRefiner(target, source).refine(*maps, ANNEALED), coarse.origin
    )


def _at_all_samples(
    target: SpectralShape, source: SpectralShape, coarse: Refined
) -> tuple[IntArray, IntArray]:
    on_target, on_source = target.basis[target.dense], source.basis[source.dense]
    size = min(on_target.shape[1], len(coarse.functional_map.C_source_target))
    c = coarse.functional_map.C_source_target[:size, :size]
    return mutual_nearest_rows(on_target[:, :size], on_source[:, :size] @ c)


def chirality_of(candidate: Refined, options: NonrigidOptions) -> float:
    """Return the determinant of the pose that a candidate asks for, -1 only where mirrored maps are asked for."""
    return -1.0 if candidate.evidence.orientation < 0 and options.orientation == "any" else 1.0


def start_maps(
    refiner: Refiner, rotation_target_source: FloatArray, *, has_normals: bool
) -> list[FunctionalMap]:
    """Return the refined map of a start (q, q) and, where normals tell, one of either orientation."""
    plain = refiner.from_rotation(rotation_target_source)
    if not has_normals:
        return [plain]
    c = plain.C_source_target
    return [plain, refiner.oriented(c, preserving=True), refiner.oriented(c, preserving=False)]


def has_normals(target: SpectralShape, source: SpectralShape) -> bool:
    """Return whether both shapes have normals, so that maps have an orientation."""
    return bool(np.isfinite(target.orientation).all() and np.isfinite(source.orientation).all())


def distinct_starts(starts: LocalMinima, num: int) -> list[int]:
    """Return positions of the first starts that differ in the lowest functions."""
    size = TUNED.num_start_compared
    kept: list[int] = []
    for i in range(len(starts)):
        gaps = [
            np.linalg.norm(starts.rotations[i, :size, :size] - starts.rotations[j, :size, :size])
            for j in kept
        ]
        if all(gap >= TUNED.same_start for gap in gaps):
            kept.append(i)
    return kept[:num]


def distinct_maps(refined: list[Refined]) -> list[Refined]:
    """Return the candidates best evidence first, of each set of nearly equal ones only the best."""
    kept: list[Refined] = []
    for candidate in sorted(refined, key=lambda c: c.score):
        kept += _others([candidate], kept)
    return kept


def _likely(coarse: list[Refined], options: NonrigidOptions) -> list[Refined]:
    """Return the candidates that are not far worse than the best; all where both orientations are asked for."""
    if options.orientation == "any":
        return coarse
    best = min((one.score for one in coarse), default=0.0)
    return [one for one in coarse if one.score < best + TUNED.likely_lead]


def _others(candidates: list[Refined], known: list[Refined]) -> list[Refined]:
    """Return the candidates that are none of the known ones."""
    maps = [one.functional_map.C_source_target for one in known]
    return [
        c
        for c in candidates
        if not any(is_same_map(c.functional_map.C_source_target, m) for m in maps)
    ]


def of_both_orientations(best: list[Refined], num: int) -> list[Refined]:
    """Return the first candidates, at least half of them orientation-preserving where there are so many."""
    preserving = [c for c in best if not c.evidence.orientation < MIXED_ORIENTATION]
    others = [c for c in best if c.evidence.orientation < MIXED_ORIENTATION]
    first = preserving[: max((num + 1) // 2, num - len(others))]
    return sorted([*first, *others[: num - len(first)]], key=lambda c: c.score)


def is_same_map(first: FloatArray, second: FloatArray) -> bool:
    """Return whether two functional maps (q, q) agree in the lowest functions."""
    size = TUNED.num_compared + 1
    return float(np.linalg.norm(first[:size, :size] - second[:size, :size])) < TUNED.same_map


def refined_with_evidence(
    target: SpectralShape, source: SpectralShape, refined: FunctionalMap, origin: str
) -> Refined:
    """Return a refined map with its evidence."""
    return Refined(
        functional_map=refined, evidence=measure_evidence(target, source, refined), origin=origin
    )


#: Difference of scores at which a candidate counts e times as much as another. Chosen on 19 pairs of bending shapes.
SCORE_SCALE = 0.35
#: Candidates that take this share of the points to the same places are no rivals; a lead is not counted as larger.
SAME_SHARE, MOST_LEAD = 0.8, 2.0


def agreements(target: SpectralShape, found: Sequence[Refined]) -> FloatArray:
    """Return the mean share of points that the candidates, weighed by score, take near to where each one does, (m,).

    Starts lead to the true map from many sides, and to each wrong one from few.
    """
    weights = _weights(found)
    return np.array(
        [(weights @ same_places(target, found, number)).mean() for number in range(len(found))]
    )


#: Weight of the orientation, at most 1, relative to the logarithm of the agreement. Chosen on 49 pairs.
#: It does not see half turns of upright bodies.
ORIENTATION_WEIGHT = 0.4


def support(agreement: FloatArray, orientations: FloatArray) -> FloatArray:
    """Return log-odds of candidates, (m,), by their agreement with the others and their orientation, (m,) each.

    Those that swap left and right are out of the question if others do not.
    """
    sides = np.nan_to_num(orientations)
    log_odds = np.log(agreement) + ORIENTATION_WEIGHT * sides
    return np.where((sides >= 0.0) | (sides < 0.0).all(), log_odds, -np.inf)


def likeliest(target: SpectralShape, found: Sequence[Refined], options: NonrigidOptions) -> int:
    """Return the position of the candidate of the largest log-odds.

    It is the one that the others agree with most and that keeps left and right most clearly, where normals tell.
    """
    sides = np.array([one.evidence.orientation for one in found])
    if options.orientation == "any":
        sides = np.abs(sides)
    return int(np.argmax(support(agreements(target, found), sides)))


def standing(target: SpectralShape, found: Sequence[Refined], number: int) -> tuple[float, float]:
    """Return how many points the other candidates take to the same places as one does, and its lead over others.

    Parameters
    ----------
    target : SpectralShape
    found : sequence of Refined
        All candidates, also those that are shown to nobody.
    number : int
        The candidate's position.
    """
    scores = np.array([one.score for one in found])
    same = same_places(target, found, number)
    others = scores[same.mean(axis=1) < SAME_SHARE]
    lead = float(others.min() - scores[number]) if len(others) else MOST_LEAD
    agreement = float((_weights(found) @ same).mean())
    return agreement, float(np.clip(lead, -MOST_LEAD, MOST_LEAD))


def trust_of(
    target: SpectralShape, source: SpectralShape, found: Sequence[Refined]
) -> tuple[float, FloatArray]:
    """Return the confidence of the first candidate, and that of its image of each working vertex of the source.

    Returns
    -------
    confidence : float
    vertex_confidence : ndarray, shape (w,)
        That of the nearest dense sample.
    """
    whole = whole_trust(target, found, 0)
    knows_sides = bool(np.isfinite(found[0].evidence.orientation))
    at_samples = point_probability(
        point_terms(target, source, found, 0), whole, knows_sides=knows_sides
    )
    return whole, at_samples[source.nearest_dense]


def whole_trust(target: SpectralShape, found: Sequence[Refined], number: int) -> float:
    """Return the confidence of the candidate at a position."""
    evidence = found[number].evidence
    return map_probability(
        map_terms(*standing(target, found, number), evidence),
        knows_sides=bool(np.isfinite(evidence.orientation)),
    )


def point_terms(
    target: SpectralShape, source: SpectralShape, found: Sequence[Refined], number: int
) -> FloatArray:
    """Return what :func:`point_probability` weighs of a candidate at the source's dense samples, shape (s, 2)."""
    forward = found[number].functional_map.map_target_source
    backward = found[number].functional_map.map_source_target
    points = source.vertices[source.dense]
    returned = np.linalg.norm(points[backward[forward]] - points, axis=1) / source.area**0.5
    agreement = _weights(found) @ same_places(target, found, number)
    return np.column_stack([np.log(LEAST_AGREEMENT + agreement), -np.log(0.1 * NEAR + returned)])


def same_places(target: SpectralShape, found: Sequence[Refined], number: int) -> FloatArray:
    """Return which points each candidate takes near to where one of them does, shape (candidates, s), as 0 and 1."""
    places = target.vertices[target.dense] / target.area**0.5
    images = np.stack([places[one.functional_map.map_target_source] for one in found])
    return (np.linalg.norm(images - images[number], axis=2) <= NEAR).astype(np.float64)


def _weights(found: Sequence[Refined]) -> FloatArray:
    """Return how much each candidate counts by its score, together 1."""
    scores = np.array([one.score for one in found])
    weights = np.exp((scores.min() - scores) / SCORE_SCALE)
    return np.asarray(weights / weights.sum())
