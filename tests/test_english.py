"""README, CONTRIBUTING and documentation keep to the rules of plain English that a program can tell."""

import re

import pytest

from tests.readme_commands import README

ROOT = README.parent
#: Most words of a sentence on average, and of nearly all sentences.
MEAN, LONG = 16, 30
#: Largest share of sentences that are longer than :data:`LONG`.
LONG_SHARE = 0.03
OTHERS = (
    README,
    ROOT / "CONTRIBUTING.md",
    ROOT / "RESULTS.md",
    ROOT / "CHANGELOG.md",
    ROOT / "paper" / "paper.md",
)
PAGES = sorted([*OTHERS, *(ROOT / "docs").rglob("*.md")])


def sentences(text):
    """Return the sentences of a Markdown page: of paragraphs and items of lists; not tables, headings and code."""
    text = re.sub(r"\A---\n.*?^---\n", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"<!--.*?-->|\$\$.*?\$\$|\\\[.*?\\\]", "", text, flags=re.DOTALL)
    text = re.sub(r"!\[[^]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"`[^`]*`|\\\(.*?\\\)", "code", text)
    lines = [line for line in text.splitlines() if not re.match(r"\s*(#|\||:::|<)", line)]
    items = re.split(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.) )", "\n".join(lines))
    ends = re.compile(r"(?<=[.!?:;])[*_\")]*\s+(?=[A-Z`*\"(\[]|code)")
    found = [one for item in items for one in ends.split(re.sub(r"^\s*([-*]|\d+\.) ", "", item))]
    return [one for one in (" ".join(one.split()) for one in found) if re.search(r"\w", one)]


def faults(text):
    """Return what breaks the rules in a page."""
    found = sentences(text)
    lengths = [len(re.findall(r"[\w'’.-]*\w", one)) for one in found]
    long = [one for one, words in zip(found, lengths, strict=True) if words > LONG]
    mean = sum(lengths) / max(1, len(found))
    said = [f"{mean:.1f} words a sentence on average, {MEAN} are enough"] if mean > MEAN else []
    if len(long) > max(1, LONG_SHARE * len(found)):
        said += [f"more than {LONG} words: {one}" for one in long]
    return said


def name(page):
    return page.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_pages_are_in_plain_english(page):
    found = faults(page.read_text("utf-8"))
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        (
            f"It is short. {'It goes on and on ' * 9}. {'And so does this one ' * 7}.",
            "more than 30",
        ),
        (f"{'It goes on and on ' * 4}.", "on average"),
    ],
)
def test_a_bad_sentence_is_noticed(bad, said):
    assert any(said in fault for fault in faults(bad))
