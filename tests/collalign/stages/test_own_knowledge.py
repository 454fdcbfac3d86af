"""What a caller knows belongs to shapes whose names nearly agree with those that it is given by."""

import numpy as np
import pytest

from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from collalign.options import AlignOptions
from collalign.products.own import Own
from collalign.stages.own_knowledge import with_known_names, with_known_options
from data_tools.errors import InputError

NAMES = ("s01", "s02", "s03")


def test_what_is_given_is_called_like_the_shapes(caplog):
    own = Own(
        samples={"S1": [1, 2, 3], "s02": [4, 5, 6]},
        marks={"s-3": {"tip": (0, 0, 1)}},
        candidates={("s1", "s02"): np.eye(3)},
        pair_weights={("s2", "s3"): 0.5},
    )
    found = with_known_names(own, NAMES)
    assert found.samples == {"s01": [1, 2, 3], "s02": [4, 5, 6]}
    assert [*found.marks] == ["s03"]
    assert [*found.candidates] == [("s01", "s02")]
    assert found.pair_weights == {("s02", "s03"): 0.5}
    assert "samples: 'S1' is taken as 's01'" in caplog.text
    own = Own(invariants=lambda shape: shape.vertices)
    assert with_known_names(own, NAMES).invariants is own.invariants


def test_reference_and_incomplete_shapes_are_called_like_the_shapes():
    for incomplete, found in ((" S1, s-2", "s01,s02"), ("auto", "auto"), ("never", "never")):
        options = AlignOptions(reference="S_3", incomplete=incomplete)
        with Session.open(options, RunOptions(jobs=1)) as session:
            known = with_known_options(session, NAMES).options
        assert (known.reference, known.incomplete) == ("s03", found)
    with (
        Session.open(AlignOptions(reference="x"), RunOptions(jobs=1)) as session,
        pytest.raises(InputError, match="reference: no shape is called 'x'"),
    ):
        with_known_options(session, NAMES)


@pytest.mark.parametrize("given", [{("s1", "s4"): 1.0}, {("s1", "x"): 1.0}])
def test_names_of_no_shape_are_refused(given):
    with pytest.raises(InputError, match=r"pair_weights: no shape is called '(s4|x)'"):
        with_known_names(Own(pair_weights=given), NAMES)


def test_the_order_of_scans_is_checked_and_called_like_the_shapes():
    assert with_known_names(Own(order=["S3", "s-1"]), NAMES).order == ("s03", "s01")
    assert Own(order=["a", "b", "c"]).some({"a", "c"}).order == ("a", "c")
    assert Own(order=["a", "b", "c"]).some({"a"}).order == ()
    assert Own(order=["a", "b"]).kinds == ("order",)
    for wrong in ("s1,s2", ["s1"], ["s1", "s1"], [1, 2]):
        with pytest.raises(InputError, match=r"^order: expected "):
            Own(order=wrong)
    with pytest.raises(InputError, match="order: no shape is called 'x'"):
        with_known_names(Own(order=["s1", "x"]), NAMES)
