"""The README's commands are there."""

import re
import subprocess

import pytest

from collalign import align_collection
from data_tools.io.listing import READERS
from data_tools.io.shapes import read_shape
from tests.readme_commands import README, command

ROOT = README.parent


@pytest.mark.parametrize(
    "text", [README.read_text("utf-8"), align_collection.__doc__, read_shape.__doc__]
)
def test_every_readable_format_is_named(text):
    sentence = next(one for one in text.split("\n\n") if "PLY" in one and "NPZ" in one)
    words = set(re.findall(r"\b[A-Z]{3,4}\b", sentence))
    assert {suffix[1:].upper() for suffix in READERS} <= words
    assert words & {"FBX", "DAE", "PTX", "VTU"} == set()


def test_missing_command_is_noticed():
    with pytest.raises(ValueError, match="no bash block"):
        command("test", "## Run the tests\n")


def test_continuous_integration_runs_the_test_command():
    script = (ROOT / ".ci" / "run").read_text()
    assert "readme_commands.py test" in script
    assert "-m tests.bare_machine" in script
    assert subprocess.run(["bash", "-n", str(ROOT / ".ci" / "run")], check=False).returncode == 0
