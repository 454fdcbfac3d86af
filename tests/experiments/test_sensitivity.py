"""Tuned numbers are found in the source, and each changes what is run with it."""

import pytest

from data_tools.errors import OptionsError
from experiments.calibration.sensitivity import measure_changed, tuned_numbers
from experiments.experiment import Cell

SOURCE = '''"""A room; 5.0 is none."""
FIRST, _SECOND = 2.0, (3, -4.5)
TABLE = {"é": 0.5, "b": other(7)} | {"c": 0}
MODEL_VERSION = 3
lower = 8


class Numbers(NamedTuple):
    share: float = 0.25
    text: str = "9"
'''


def test_each_number_has_a_name_and_a_place(tmp_path):
    for package in ("collalign", "pairwise", "data_tools"):
        (tmp_path / package).mkdir()
    (tmp_path / "collalign" / "room.py").write_text(SOURCE)
    found = tuned_numbers(["collalign"], root=tmp_path)
    values = {one.name.removeprefix("collalign.room."): one.value for one in found}
    assert values == {
        "FIRST": 2.0, "_SECOND[0]": 3, "_SECOND[1]": 4.5, "TABLE": 0.5, "Numbers.share": 0.25,
    }  # fmt: skip
    content = SOURCE.encode()
    assert [float(content[one.start : one.end]) for one in found] == [*values.values()]
    assert [one.changed(0.5) for one in found[:2]] == [1.0, 2]
    assert tuned_numbers(["collalign.room._SECOND"], root=tmp_path) == found[1:3]
    with pytest.raises(OptionsError, match="NOTHING: holds no tuned number"):
        tuned_numbers(["collalign.room.NOTHING"], root=tmp_path)


def test_a_changed_number_changes_the_run(tmp_path):
    """In a copy of the product: nothing states more than half of the most that may be stated."""
    (number,) = tuned_numbers(["collalign.confidence.pose_model.MOST_CONFIDENT"])
    change = {name: getattr(number, name) for name in ("file", "start", "end")}
    settings = {"set": "generated families", "name": "chairs", "draw": 0, "code": ""}
    cell = Cell(data=tmp_path, settings=settings | change | {"text": "0.5"})
    assert 0.4 < measure_changed(cell)["stated"].max() <= 0.5
    assert number.value > 0.9
