"""Which components pose a collection is decided by what the largest ones lose and how sure they are."""

from types import SimpleNamespace

import numpy as np
import pytest

from collalign import AlignOptions, RunOptions
from collalign.engine.session import Session
from collalign.stages.components import pose_with_components
from collalign.stages.steps import Matched
from data_tools.notes import Note
from data_tools.options import CleaningOptions
from data_tools.surface.cleaning import COMPONENTS_KEPT
from tests.notes import codes

SURE, DOUBT, WORSE = (0.97, 0.93, 0.92, 0.85), (0.97, 0.8, 0.6, 0.5), (0.6, 0.6, 0.6, 0.5)
UNKNOWN = (np.nan,) * 4


@pytest.mark.parametrize(
    ("asked", "kept", "largest", "whole", "chosen", "times"),
    [
        ("auto", 50.0, DOUBT, SURE, "all", 2),
        ("auto", 50.0, DOUBT, WORSE, "largest", 2),
        ("auto", 50.0, SURE, SURE, "largest", 1),
        ("auto", 50.0, (0.97, 0.97, 0.97, 0.2), SURE, "all", 2),
        ("auto", 99.0, DOUBT, SURE, "largest", 1),
        ("auto", 50.0, UNKNOWN, UNKNOWN, "all", 2),
        ("largest", 50.0, DOUBT, SURE, "largest", 1),
        ("all", 50.0, SURE, DOUBT, "all", 1),
        ("auto", 50.0, (0.97, 0.92), SURE, "all", 2),  # two are left out
    ],
)
def test_all_components_are_taken_where_they_leave_less_in_doubt(
    asked, kept, largest, whole, chosen, times
):
    posed = []

    def posed_with(session):
        components = session.options.cleaning.components
        posed.append(components)
        lost = [Note(COMPONENTS_KEPT, values={"share": kept if components != "all" else 100.0})]
        confidence = np.array(whole if components == "all" else largest)
        samples = [SimpleNamespace(notes=lost)] * len(confidence)
        shapes = SimpleNamespace(samples=samples, excluded=("few points",) * (4 - len(samples)))
        solution = SimpleNamespace(confidence=confidence)
        matched = Matched(group="SO", pairs=[], failed=[], solution=None, notes=())
        return (
            SimpleNamespace(session=session, shapes=shapes),
            matched,
            SimpleNamespace(solution=solution),
        )

    options = AlignOptions(cleaning=CleaningOptions(components=asked))
    with Session.open(options, RunOptions(jobs=1)) as session:
        run, matched, _ = pose_with_components(session, posed_with)
    assert run.session.options.cleaning.components == chosen
    assert len(posed) == times
    assert codes(matched.notes) == (["components-joined"] if times == 2 and chosen == "all" else [])
