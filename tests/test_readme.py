"""The README's commands are there."""

import subprocess

import pytest

from tests.readme_commands import README, command

ROOT = README.parent


def test_commands_set_up_and_run():
    text = README.read_text("utf-8")
    assert "collalign demo" in command("demo", text)
    assert command("test", text).endswith("-m pytest -n 2")
    for name in ("demo", "test"):
        assert "pip install" in command(name, text)


def test_missing_command_is_noticed():
    with pytest.raises(ValueError, match="no bash block"):
        command("test", "## Run the tests\n")


def test_continuous_integration_runs_the_test_command():
    script = (ROOT / ".ci" / "run").read_text()
    assert "readme_commands.py test" in script
    assert subprocess.run(["bash", "-n", str(ROOT / ".ci" / "run")], check=False).returncode == 0
