"""The bare machine shows nothing of this one, and notices a command that fails or complains there."""

import sys

import pytest

from tests.bare_machine import STAND_INS, BareMachine, refuse_complaints
from tests.optional import optional_program


@pytest.fixture
def machine(tmp_path):
    for name in ("bash", "sleep"):
        optional_program(name, install="the programs that every Debian has")
    return BareMachine(tmp_path)


def python(machine, code):
    return machine.run(sys.executable, "-c", code, folder=machine.home)


def test_programs_and_variables_of_this_machine_are_not_seen(machine, monkeypatch):
    monkeypatch.setenv("COLLALIGN_SECRET", "5")
    python(
        machine,
        "import os, shutil; from pathlib import Path\n"
        "lacking = ('cc', 'gcc', 'git', 'chromium', 'Rscript', 'node', 'pgrep')\n"
        "assert not any(map(shutil.which, lacking)) and shutil.which('sh')\n"
        "assert 'COLLALIGN_SECRET' not in os.environ and not any(Path.home().iterdir())",
    )
    machine.run(
        "python3", "-c", "import venv, sys; assert sys.prefix == sys.base_prefix", folder="."
    )


@pytest.mark.parametrize("name", STAND_INS)
def test_what_needs_a_library_of_the_system_cannot_be_imported(machine, name):
    with pytest.raises(SystemExit, match="failed with exit code 1"):
        python(machine, f"import {name}")


def test_a_command_that_fails_is_noticed(machine):
    with pytest.raises(SystemExit, match="failed with exit code 3"):
        python(machine, "raise SystemExit(3)")


@pytest.mark.parametrize(
    "code",
    [
        "import warnings; warnings.warn('something')",
        "import threading; threading.Thread(target=lambda: 1 / 0).start()",
    ],
)
def test_a_complaint_of_a_command_that_succeeds_is_noticed(machine, code):
    refuse_complaints(python(machine, "print('Note: all is well')"))
    with pytest.raises(SystemExit, match="complains"):
        refuse_complaints(python(machine, code))
