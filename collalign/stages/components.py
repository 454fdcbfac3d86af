"""Which components of shapes are matched: the largest of each, or all, as of objects that are assembled of parts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from collalign.options import AUTO, AlignSession
from collalign.products.trust import UNCERTAIN
from collalign.stages.steps import Matched, Posed, Run
from data_tools.arrays import FloatArray
from data_tools.notes import Note
from data_tools.options import Components
from data_tools.surface.cleaning import are_assembled

#: The run of shapes, their pairs, their poses.
_Answer: TypeAlias = tuple[Run, Matched, Posed]


def pose_with_components(
    session: AlignSession, posed_with: Callable[[AlignSession], _Answer]
) -> _Answer:
    """Pose shapes by the components that ``cleaning.components`` asks for; "auto" decides.

    The largest components alone pose most shapes best: geodesics and spectra are of one surface. Where most shapes
    lose much without the others, and the mean confidence is low or unknown, all shapes are posed once more by the
    surface around all components. The poses of the higher mean confidence stay. Guitars and pianos are sure by their
    bodies; of generated chairs, beds and cars, which are assembled of boxes, the largest box says little.

    Parameters
    ----------
    session : Session
    posed_with : callable
        Poses the shapes with the options of a session.

    Returns
    -------
    run, matched, posed
        The session of the run has the decision among its options; ``matched`` has a note if all components count.
    """
    cleaning = session.options.cleaning
    if cleaning.components != AUTO:
        return posed_with(session)

    def posed(components: Components) -> _Answer:
        decided = replace(cleaning, components=components)
        return posed_with(replace(session, options=replace(session.options, cleaning=decided)))

    answer = posed("largest")
    lost = [samples.notes for samples in answer[0].shapes.samples]
    if not are_assembled(cleaning, lost) or _confidences(answer).mean() >= UNCERTAIN:
        return answer
    whole = posed("all")
    if _confidences(whole).mean() <= _confidences(answer).mean():
        return answer
    run, matched, poses = whole
    return run, replace(matched, notes=(Note("components-joined"), *matched.notes)), poses


def _confidences(answer: _Answer) -> FloatArray:
    """Return the confidences of all shapes (N,), 0 of those left out: the largest component may have few vertices."""
    run, _, posed = answer
    return np.append(posed.solution.confidence, np.zeros(len(run.shapes.excluded)))
