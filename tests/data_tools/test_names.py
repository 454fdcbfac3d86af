"""Which shapes are meant by names that nearly agree."""

import logging
import unicodedata

import pytest

from data_tools.errors import InputError
from data_tools.names import by_known_names, known_names, match_names, nearest_names


@pytest.mark.parametrize(
    ("asked", "known"),
    [
        ("1", "001"),
        ("1.0", "001"),
        ("s1", "S-001"),
        ("r femur 07", "R_Femur_7"),
        ("AMNH–12", "AMNH 12"),
        ("ＡＢ１", "ab1"),
        (unicodedata.normalize("NFD", "Köln"), "Köln"),
        (r"C:\data\bones\s2.ply", "s2"),
        ("pictures/S_2.JPG", "s2"),
        ("AMNH 100/skull.mrk.json", "AMNH 100/skull"),
        ("/home/me/amnh_0100/skull", "AMNH 100/skull"),
        ("skull", "AMNH 100/skull"),
        ("AMNH-100", "AMNH 100/skull"),
        ("AMNH 100/landmarks", "AMNH 100"),
    ],
)
def test_one_name_that_nearly_agrees_is_meant(asked, known):
    others = ["zebra", "x/y", "s20", "AMNH 120"]
    assert match_names([asked], [known, *others]) == {asked: known}
    assert match_names([asked], others) == {}


@pytest.mark.parametrize(
    ("asked", "known"),
    [
        (["1"], ["01", "001"]),  # several
        (["skull"], ["a/skull", "b/skull"]),
        (["101/skull"], ["100/skull", "102/skull"]),  # another folder's
        (["1-11"], ["11-1", "111"]),
        (["a1", "A-1"], ["A01"]),  # two for one
        (["v1.2"], ["v12"]),
        (["???", ""], ["!!!", "-"]),
    ],
)
def test_what_may_mean_several_or_none_is_not_taken(asked, known):
    assert match_names(asked, known) == {}


def test_near_names_are_told_and_unknown_ones_refused_with_the_nearest(caplog):
    with caplog.at_level(logging.WARNING):
        assert known_names("exclude", ["a", "b.ply"], ["a", "b"]) == {"a": "a", "b.ply": "b"}
        assert not caplog.messages
        assert by_known_names("fixed", {"B-1": 3, "a": 4}, ["a", "b01"]) == {"b01": 3, "a": 4}
    assert caplog.messages == ["fixed: 'B-1' is taken as 'b01'"]
    with pytest.raises(
        InputError, match=r"^exclude: no shape is called '1'; did you mean '01' or '001'\?"
    ):
        known_names("exclude", ["1"], ["01", "001", "2"])
    with pytest.raises(InputError, match=r"^factors: no column is called 'q'; there are sex, age$"):
        known_names("factors", ["q"], ["sex", "age"], kind="column")
    assert nearest_names("femur", ["femur_17", "femur_70", "ulna"]).count("femur_") == 2
    assert nearest_names("q", []) == ""
