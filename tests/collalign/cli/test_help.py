"""The help fits a screen first, and all of it is there when asked for."""

import re

import pytest

from collalign.cli import app
from tests.commands import run_command


def options_in(text):
    """Return the names of all options that a help text lists; their last column may be cut."""
    return set(re.findall(r"^│[ *]+(?:[A-Z-]+ )?(--[a-z][a-z.-]*)", text, re.MULTILINE))


@pytest.fixture(autouse=True)
def _wide_terminal(monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")


def test_one_screen_first_and_everything_when_asked_for():
    first = run_command("align", "--help").out
    everything = run_command("align", "--help-all").out
    named = {
        argument.name for argument in app["align"].assemble_argument_collection() if argument.show
    }
    named |= {"--config", "--verbose", "--quiet", "--json", "--log"}
    assert named <= options_in(everything)
    shown = options_in(first) & named
    assert {"--folder", "--out", "--group", "--jobs"} <= shown < named
    assert len(first.splitlines()) <= 40
    assert f"--help-all shows {len(named - shown)} more options" in first
    for title in ("Basic", "Sampling", "Matching", "Running", "Advanced"):
        assert f"─ {title} ─" in everything


def test_commands_with_few_options_show_them_all():
    for flag in ("--help", "--help-all"):
        said = run_command("status", flag).out
        assert "--help-all shows" not in said
        assert "--result" in options_in(said)


def test_help_shows_first_what_a_command_is_for():
    said = run_command("transfer", "--help").out
    assert {"--result", "--landmarks", "--to", "--format"} <= options_in(said)
