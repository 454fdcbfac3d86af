"""Sentences of tools say what was done, by whom shapes were left out, and need their references."""

import pytest

from collalign.output.methods.of_tools import TOOLS
from tests.collalign.output.test_methods import OPTIONS, TESTS


def told(tool, **changes):
    """All sentences of a tool, and the references that they need."""
    sentences = [*TOOLS[tool](OPTIONS[tool] | changes)]
    return " ".join(said for said, _ in sentences), [
        one for _, needed in sentences for one in needed
    ]


def test_shapes_are_left_out_by_the_authors_or_by_the_program():
    left_out = [["a", "excluded"], ["b", "doubtful"], ["c", "incomplete"], ["d", "not-registered"]]
    said, _ = told("variation", left_out=left_out)
    assert "We left out 1 specimen (a)." in said
    assert (
        "The program left out poses of a confidence below 95 % (b); incomplete surfaces (c);"
        in said
    )
    assert "could not lay the mean surface (d)." in said
    said, _ = told("variation", left_out=[], include_doubtful=True)
    assert "left out" not in said
    assert "By our choice, poses of a confidence below 95 % counted" in said


@pytest.mark.parametrize(
    ("changes", "words", "author"),
    [
        ({"symmetry": "auto"}, "within each specimen", "Barluenga"),
        ({"sides": ["left"], "individuals": ["a"]}, "Left and right", "McIntyre"),
        ({"individuals": ["a"]}, "repeated measurements", "Lessells"),
        ({"repeats": ["x.csv"]}, "placed again", "Fruciano"),
        ({"tests": TESTS | {"blocks": ["face=1..8", "base=9..17"]}}, "two-block", "Rohlf"),
        ({"without_posture": True}, "mean place first", "articulated"),
    ],
)
def test_what_was_asked_for_is_told_with_its_references(changes, words, author):
    said, references = told("variation", **changes)
    assert words in said
    assert any(author in one for one in references)
    plain, few = told("variation")
    assert words not in plain
    assert not any(author in one for one in few)


def test_a_transfer_tells_templates_semilandmarks_and_errors():
    curves = [
        {"kind": "curve", "num": 9},
        {"kind": "curve", "num": 9},
        {"kind": "patch", "num": 40},
    ]
    said, references = told(
        "transfer",
        templates=["a", "b", "c"],
        semilandmarks=curves,
        slide="bending",
        num_contradicted=2,
        left_out_error=0.1512,
        left_out_median=0.12,
    )
    assert "from 3 templates (a, b, c)" in said
    assert "(2 cases)" in said
    assert "58 of them are semilandmarks on 2 curves, 1 patch." in said
    assert "the bending energy from the mean is least" in said
    assert "a mean error of 0.151 (median 0.12)" in said
    assert any("Gunz" in one for one in references)
    assert "The program did not place 2 landmarks" in said
    assert "did not place" not in told("transfer", num_lacking=0)[0]
    single, few = told("transfer")
    assert "contradicted" not in single
    assert not any("Gunz" in one for one in few)


def test_an_export_says_in_which_coordinates():
    options = {"exclude": ["a"], "right": None, "space": "unscaled"}
    said = " ".join(sentence for sentence, _ in TOOLS["export"](options))
    assert said.startswith("We left out 1 specimen (a)")
    assert "in the units of the files" in said
    assert "surest" not in said
    sure = " ".join(sentence for sentence, _ in TOOLS["export"](options | {"right": 0.99}))
    assert "expects 99.0% or more to be right" in sure
