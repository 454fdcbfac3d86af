"""The steps of one alignment of complete shapes, in the order of section 6.3 of Maron et al. (2016).

Each takes the run and what was found before, and returns that with more; :mod:`collalign.stages.posing` takes one
after the other.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from typing import Literal

from collalign.confidence.pose_model import resembles_none
from collalign.confidence.side_model import MIN_SHAPES_FOR_SIDES
from collalign.options import AlignSession
from collalign.products.consistent_maps import VertexMaps
from collalign.products.pair import AlignedPair, FormerPairs, Pair, are_weighed
from collalign.products.shapes import Constraints, Excluded, ExtraMaterial, Incomplete, Shapes
from collalign.products.trust import Trust
from collalign.stages.choose_pairs import choose_pairs, describe_shapes, grow_pairs, match_chosen
from collalign.stages.deformation import map_vertices, vertex_notes
from collalign.stages.evidence.weigh import wants_maps, weigh_doubtful_pairs, weigh_pairs
from collalign.stages.mixed_sides import decide_group
from collalign.stages.poses.agreement import with_common_match
from collalign.stages.poses.placement import (
    common_positions,
    fix_frame,
    in_label_order,
    labels_at_common_poses,
    place_and_scale,
    with_origin,
)
from collalign.stages.poses.refinement import refine_poses
from collalign.stages.poses.synchronize import synchronize_shapes
from collalign.stages.proofs import certify_pairs, contradictions
from collalign.stages.trust.assess import gather_trust, with_trust
from collalign.stages.trust.trust_notes import remedies, trust_notes
from collalign.synchronization import SynchronizationResult
from data_tools.arrays import FloatArray, IntArray
from data_tools.notes import Note
from data_tools.surface.extra import ExtraSurface


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """What a run works on: shapes, what is known and decided about them, and the seconds of its stages so far.

    ``read_without`` reads the shapes again, without extra material of some of them, by name.
    """

    session: AlignSession
    shapes: Shapes
    read_without: Callable[[Mapping[str, ExtraSurface]], Shapes]
    constraints: Constraints
    former: FormerPairs | None
    times_s: dict[str, float]

    def stage(self, name: str) -> AbstractContextManager[None]:
        """Say in the store what the run does, and time it."""
        return timed(self.session, self.times_s, name)

    def some(self, kept: Sequence[int]) -> Run:
        """Return the run of some of the shapes."""
        return replace(
            self,
            shapes=self.shapes.some(kept),
            constraints=self.constraints.some(kept),
            former=self.former and self.former.some(kept),
        )


def with_group(run: Run, group: str) -> Run:
    """Return the run with the group that was decided."""
    return replace(run, session=with_decided_group(run.session, group))


def with_decided_group(session: AlignSession, group: str) -> AlignSession:
    """Return the session with a group, in which nothing is reflected unless it is "O"."""
    options = replace(session.options, group="O" if group == "O" else "SO")
    return replace(session, options=options)


@dataclass(frozen=True, kw_only=True, eq=False)
class Matched:
    """The pairs, what to say about them, and the synchronization of exactly these where there is one already."""

    group: Literal["SO", "O"]
    pairs: list[Pair]
    failed: list[Excluded]
    solution: SynchronizationResult | None
    notes: tuple[Note, ...]
    side_chances: Mapping[int, float] = field(default_factory=dict)


def match(run: Run) -> tuple[Run, Matched]:
    """Choose pairs, decide the group, match, and match further pairs where poses are uncertain."""
    session, shapes = run.session, run.shapes
    with run.stage("pairs"):
        descriptors = describe_shapes(shapes)
        edges = choose_pairs(session, shapes, descriptors, run.constraints, run.former)
        group, notes, side_chances = decide_group(
            session,
            shapes,
            descriptors,
            edges,
            former=run.former,
            any_mirrored=run.constraints.any_mirrored,
        )
        run = with_group(run, group)
        session = run.session
        pairs, failed = match_chosen(session, shapes, edges, run.constraints)
        pairs, failed, solution = grow_pairs(
            session, shapes, descriptors, edges, pairs, failed, run.constraints
        )
    matched = Matched(
        group=group,
        pairs=pairs,
        failed=failed,
        solution=solution,
        notes=notes,
        side_chances=side_chances,
    )
    return run, matched


def unmatched(run: Run) -> Matched:
    """Return no pairs of shapes that are not matched as whole shapes; reflected only where that is asked for."""
    group: Literal["SO", "O"] = "O" if run.session.options.group == "O" else "SO"
    return Matched(group=group, pairs=[], failed=[], solution=None, notes=())


def prove(run: Run, matched: Matched) -> Matched:
    """Prove poses of pairs, where that is asked for."""
    if not run.session.options.certify:
        return matched
    with run.stage("proofs"):
        pairs, solution, proven = certify_pairs(
            run.session, run.shapes, matched.pairs, matched.solution
        )
    return replace(matched, pairs=pairs, solution=solution, notes=(*matched.notes, proven))


def weigh(run: Run, matched: Matched) -> Matched:
    """Let non-rigid maps propose poses and judge all, where shapes bend."""
    if not wants_maps(run.session.options, run.shapes, matched.pairs):
        return matched
    with run.stage("maps"):
        pairs = weigh_pairs(run.session, run.shapes, matched.pairs)
    # Mirrored energies of few shapes cannot tell a mirrored body from one in another posture; maps can.
    are_few = matched.group == "SO" and len(run.shapes.names) < MIN_SHAPES_FOR_SIDES
    side_chances = {} if are_few else matched.side_chances
    return replace(matched, pairs=pairs, solution=None, side_chances=side_chances)


@dataclass(frozen=True, kw_only=True, eq=False)
class Posed:
    """The poses, with all that follows from them.

    ``matched`` are the pairs as they were first matched.
    ``consensus`` is the mean position of every label, that of complete shapes where there are incomplete ones.
    ``side_chances`` are the chances that the side of a shape is right, where that is in doubt.
    ``seem_incomplete`` says of some shapes why they may be incomplete, though they were posed with the others.
    ``limited_by`` are the codes of what limits confidences, empty where nothing does.
    """

    pairs: list[AlignedPair]
    matched: list[Pair]
    solution: SynchronizationResult
    rotations: FloatArray
    transforms: FloatArray
    labels: IntArray
    consensus: FloatArray
    notes: tuple[Note, ...]
    side_chances: Mapping[int, float]
    seem_incomplete: Mapping[int, str] = field(default_factory=dict)
    limited_by: tuple[str, ...] = ()
    trust: Trust | None = None
    vertices: VertexMaps | None = None
    incomplete: tuple[Incomplete, ...] = ()
    extra: tuple[ExtraMaterial, ...] = ()

    @property
    def confidence_but_for_sides(self) -> FloatArray:
        """The confidences (N,) if every side were right."""
        confidence = self.solution.confidence.copy()
        for i, chance in self.side_chances.items():
            confidence[i] /= chance
        return confidence


def pose(run: Run, matched: Matched) -> Posed:
    """Synchronize, refine, and settle frame, labels and places."""
    session, options, samples, constraints = (
        run.session,
        run.session.options,
        run.shapes.samples,
        run.constraints,
    )
    with run.stage("synchronization"):
        with session.alone("synchronization"):
            solution = synchronize_shapes(
                options, samples, matched.pairs, constraints, known=matched.solution
            )
        rotations = refine_poses(session, samples, matched.pairs, solution, constraints)
        with session.alone("common matches"):
            rotations, solution = fix_frame(options, samples, rotations, solution, constraints)
            settled = with_common_match(samples, matched.pairs, solution, rotations)
            labels = labels_at_common_poses(samples, settled, rotations)
    transforms = place_and_scale(
        samples, rotations, labels, options.scaling, fixed=constraints.fixed_transforms
    )
    transforms = with_origin(transforms, constraints)
    return Posed(
        pairs=settled,
        matched=list(matched.pairs),
        solution=solution,
        rotations=rotations,
        transforms=transforms,
        labels=labels,
        consensus=in_label_order(common_positions(samples, transforms), labels).mean(axis=0),
        notes=contradictions(run.shapes.names, settled, rotations),
        side_chances=matched.side_chances,
    )


def state_trust(run: Run, posed: Posed) -> Posed:
    """State how far each pose can be trusted."""
    session, samples = run.session, run.shapes.samples
    if session.options.synchronization != "robust":
        return posed
    with run.stage("confidence"):
        trust = gather_trust(
            session, samples, posed.matched, posed.rotations, posed.solution.components
        )
        solution, limited_by = with_trust(
            posed.solution, trust, run.constraints, posed.side_chances, posed.seem_incomplete
        )
        notes = trust_notes(run.shapes.names, trust, solution.confidence, run.constraints)
        posed = replace(posed, solution=solution, limited_by=limited_by, trust=trust)
        strange = resembles_none(trust.evidence)
        helps = remedies(
            run.session, run.shapes, posed.matched, posed.confidence_but_for_sides, strange
        )
    return replace(posed, notes=(*posed.notes, *notes, *helps))


def reconsider_doubtful(run: Run, matched: Matched, posed: Posed) -> Posed:
    """Weigh and pose doubtful shapes anew, where maps were made."""
    if not are_weighed(matched.pairs):
        return posed
    with run.stage("maps"):
        pairs = weigh_doubtful_pairs(
            run.session, run.shapes, matched.pairs, posed.rotations, posed.solution.confidence
        )
    if all(pair is before for pair, before in zip(pairs, matched.pairs, strict=True)):
        return posed
    again = pose(run, replace(matched, pairs=pairs, solution=None))
    return state_trust(run, replace(again, seem_incomplete=posed.seem_incomplete))


def with_vertices(run: Run, posed: Posed) -> Posed:
    """Map all vertices between all shapes, where that is asked for."""
    if not run.session.options.deformable:
        return posed
    with run.stage("vertices"):
        vertices = map_vertices(run.session, run.shapes, posed.pairs, posed.rotations)
    return replace(posed, vertices=vertices, notes=(*posed.notes, *vertex_notes(vertices)))


@contextmanager
def timed(session: AlignSession, times_s: dict[str, float], stage: str) -> Iterator[None]:
    """Say in the store what a run does, and time it."""
    session.enter(stage)
    start_s = time.perf_counter()
    yield
    times_s[stage] = times_s.get(stage, 0.0) + time.perf_counter() - start_s
