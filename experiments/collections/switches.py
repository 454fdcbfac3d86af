"""Mechanisms of a run, and what takes the place of each where it is switched off: for the experiment alone."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pkgutil import resolve_name
from typing import Any
from unittest.mock import patch

import joblib
import numpy as np

from collalign.confidence import pose_model
from collalign.products.trust import Trust
from collalign.stages.match_pairs import MATCHING
from collalign.stages.mixed_sides import decide_group
from collalign.stages.trust import rival_poses as rivals
from collalign.synchronization.model import PRIORS
from data_tools.arrays import FloatArray

#: What a switch needs of a collection to change anything, and which of its results are taken from a store.
ALWAYS, BENT, OPEN = "always", "bent", "open"
SHAPES, PAIRS, MAPS = "shapes", "pairs", "maps"


@dataclass(frozen=True, kw_only=True)
class Switch:
    """How one mechanism is switched off.

    Attributes
    ----------
    patches : dict of str to object
        What takes the place of attributes, by their dotted names.
    where : {"always", "bent", "open"}
        Collections in which the mechanism may do anything: all, those posed with maps, or those with open surfaces.
    since : {"maps", "pairs", "shapes"}
        The last results that are taken from the store: those of maps, of pairs, or of shapes alone.
    """

    patches: dict[str, Any]
    where: str = ALWAYS
    since: str = MAPS


@contextmanager
def switched_off(switch: Switch) -> Iterator[None]:
    """Run the block without a mechanism, in this process alone."""
    with ExitStack() as stack:
        for target, replacement in switch.patches.items():
            stack.enter_context(patch(target, replacement))
        yield


def _given(position: int) -> Callable[..., Any]:
    """Return a function that returns one of its arguments."""
    return lambda *arguments, **_: arguments[position]


def _always(value: Any) -> Callable[..., Any]:
    return lambda *_, **__: value


def _priors(**changed: Any) -> Any:
    return PRIORS._replace(**changed)


def _without_ties(trust: Trust) -> FloatArray:
    """Return confidences that do not share what rivals that fit as well have."""
    alike = np.array([len(rotations) for rotations in trust.symmetries])
    single = pose_model.probability(trust.evidence)
    shared = pose_model.symmetric_confidence(trust) / np.maximum(alike, 1)
    return np.where(alike > 1, np.minimum(single, shared), single)


def _no_limits(*arguments: Any, **keywords: Any) -> Any:
    group, note, _ = decide_group(*arguments, **keywords)
    return group, note, {}


def _no_rotations(edges: Any, costs: Any, *, start: FloatArray, fixed: Any) -> FloatArray:
    return start


_COSTS = "collalign.confidence.candidate_model"
_SYNC = "collalign.synchronization"
_TRUST = "collalign.stages.trust.assess"
_MODEL = "collalign.confidence.pose_model"
_STEPS = "collalign.stages.steps"
_ONE_WAY = np.array([10.0, 0.0, 3.0, 0.6])

#: What takes most of a run after its pairs, and depends on nothing but its arguments: no switch reaches below.
PURE = (
    "collalign.stages.mixed_sides.chirality_energies",
    "collalign.stages.mixed_sides.chirality_scores",
    "collalign.stages.poses.bent.measure_pair",
    "collalign.stages.poses.refinement.refine_pair",
    f"{_TRUST}.near_symmetries",
    f"{_TRUST}.pose_costs",
)


class Remembered:
    """Results of :data:`PURE` by their arguments, so that runs that differ by a switch compute only what differs.

    Attributes
    ----------
    saved_s : float
        CPU time that all results took that were looked up.
    """

    def __init__(self) -> None:
        self.saved_s = 0.0
        self._results: dict[str, tuple[Any, float]] = {}

    @contextmanager
    def used(self) -> Iterator[None]:
        """Look results up within the block, in this process alone."""
        with ExitStack() as stack:
            for name in PURE:
                stack.enter_context(patch(name, self._looked_up(name, resolve_name(name))))
            yield

    def _looked_up(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def look_up(*arguments: Any, **keywords: Any) -> Any:
            key = f"{name} {joblib.hash((arguments, keywords))}"
            if key not in self._results:
                start_s = time.process_time()
                value = function(*arguments, **keywords)
                self._results[key] = value, time.process_time() - start_s
            else:
                self.saved_s += self._results[key][1]
            return self._results[key][0]

        return look_up


SWITCHES: dict[str, Switch] = {
    # pairs
    "neighbourhoods in the costs of candidates": Switch(
        patches={f"{_COSTS}.MISMATCH_POWER": 0.0, f"{_COSTS}.ENERGY_POWER": 1.0}
    ),
    "rotations that neighbourhoods propose": Switch(
        patches={
            "collalign.whole_pairs.match_whole.CONVINCING": 0.0,
            "collalign.stages.match_pairs.MATCHING": replace(
                MATCHING, version="pair without proposals"
            ),
        },
        since=SHAPES,
    ),
    "sides found by a pilot": Switch(patches={f"{_STEPS}.decide_group": _always(("SO", "", {}))}),
    "limits of shapes whose side is open": Switch(patches={f"{_STEPS}.decide_group": _no_limits}),
    "growing the graph of pairs": Switch(patches={"collalign.stages.choose_pairs.MAX_ROUNDS": 0}),
    # maps
    "maps": Switch(patches={f"{_STEPS}.wants_maps": _always(False)}, where=BENT, since=PAIRS),
    "settling doubts by maps": Switch(
        patches={f"{_STEPS}.reconsider_doubtful": _given(2)}, where=BENT, since=PAIRS
    ),
    "averaging over seven ways": Switch(
        patches={
            "collalign.stages.poses.refinement.bent_poses": lambda *arguments, fixed: (
                arguments[3].rotations
            )
        },
        where=BENT,
    ),
    # synchronization
    "turns chosen by beliefs": Switch(patches={f"{_SYNC}.search.propagate_beliefs": _no_rotations}),
    "turns common to wrong pairs": Switch(
        patches={f"{_SYNC}.hypotheses.PRIORS": _priors(rare_flip=9.0)}
    ),
    "blurred noise where turns are chosen": Switch(
        patches={f"{_SYNC}.search.PRIORS": _priors(label_noise_factors=(1.0, 1.0))}
    ),
    # refinement
    "refinement": Switch(
        patches={f"{_STEPS}.refine_poses": lambda *arguments: arguments[3].rotations}
    ),
    # confidence
    "own turns": Switch(patches={f"{_TRUST}.near_symmetries": _always(np.zeros((0, 3, 3)))}),
    "copies": Switch(
        patches={
            f"{_TRUST}.are_copies": _always(False),
            f"{rivals.__name__}.are_copies": _always(False),
        }
    ),
    "ties": Switch(patches={f"{_TRUST}.pose_confidence": _without_ties}),
    "limits of misfits, blocks and few shapes": Switch(
        patches={f"{_MODEL}.UNCERTAIN": pose_model.MOST_CONFIDENT}
    ),
    "limit by cycles": Switch(patches={f"{_MODEL}.LIMIT_WEIGHTS": np.array([50.0, 0.0, 0.0])}),
    "shapes that resemble no other": Switch(patches={f"{_MODEL}.STRANGE": np.inf}),
    "dense margin beside the local one": Switch(patches={f"{_MODEL}.POSE_WEIGHTS": _ONE_WAY}),
    # incomplete shapes
    "looking for incomplete shapes": Switch(
        patches={"collalign.stages.posing.find_incomplete": _always({})}, where=OPEN
    ),
    "trying scans": Switch(
        patches={"collalign.stages.posing._may_be_scans": _always(False)}, where=OPEN
    ),
}
