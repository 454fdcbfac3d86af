"""Runs the README's commands on a machine that has nothing else: no compiler, browser, R, git or Tk, a broken Open3D.

Usage: .venv/bin/python -m tests.bare_machine, after the README's test command; .ci/run does both.

The demonstration is run as the README says, in an unpacked source archive with an environment of its own. The whole
suite has run before, with the same packages, so only the tests that ask for a program or for Open3D run again.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.readme_commands import README, command

ROOT = README.parent
#: What every Debian has, as far as the commands and the tests use it. Python is added.
PROGRAMS = (
    "bash",
    "cat",
    "cp",
    "env",
    "false",
    "grep",
    "ls",
    "mkdir",
    "mv",
    "rm",
    "sed",
    "sh",
    "sleep",
    "true",
)
#: Modules that cannot be imported there, and how it fails.
STAND_INS = {
    "open3d": "libusb-1.0.so.0: cannot open shared object file: No such file or directory",
    "tkinter": "libtk8.6.so: cannot open shared object file: No such file or directory",
}
#: How this machine reaches the package index.
INDEX = re.compile(r"PIP_\w+|\w+_proxy|SSL_CERT_(FILE|DIR)|REQUESTS_CA_BUNDLE", re.IGNORECASE)
#: What no command of collalign prints.
COMPLAINT = re.compile(r"^Traceback |\b[A-Z]\w+Warning: ", re.MULTILINE)
#: Tests that ask for what is not there, by helper or by fixture.
ASKS = re.compile(r"optional_program\(|\"open3d\"|def \w+\([^)]*\b(browser|driver)\b")


class BareMachine:
    """A folder with the few programs and the stand-ins, and the environment that shows nothing else.

    Parameters
    ----------
    folder : Path
        Empty.
    """

    def __init__(self, folder):
        self.bin, self.stand_ins, self.home = (folder / name for name in ("bin", "lib", "home"))
        for made in (self.bin, self.stand_ins, self.home):
            made.mkdir()
        for name in PROGRAMS:
            (self.bin / name).symlink_to(shutil.which(name))
        python = self.bin / "python3"
        python.write_text(f'#!/bin/sh\nexec {sys.base_prefix}/bin/python3 "$@"\n')
        python.chmod(0o755)
        for name, reason in STAND_INS.items():
            (self.stand_ins / f"{name}.py").write_text(f"raise ImportError({reason!r})\n")
        self.environment = {
            "PATH": str(self.bin),
            "HOME": str(self.home),
            "PYTHONPATH": str(self.stand_ins),
            **{name: value for name, value in os.environ.items() if INDEX.fullmatch(name)},
            **pip_places(),
        }

    def run(self, *words, folder):
        """Run a command, which must succeed; show and return what it prints."""
        began_s = time.perf_counter()
        print(f"bare machine: {' '.join(map(str, words))[:200]}", flush=True)
        done = subprocess.run(
            words,
            cwd=folder,
            env=self.environment,
            check=False,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=1200,
        )
        print(done.stdout, flush=True)
        if done.returncode:
            raise SystemExit(f"bare machine: failed with exit code {done.returncode}: {words[-1]}")
        print(f"bare machine: took {time.perf_counter() - began_s:.0f} s", flush=True)
        return done.stdout


def refuse_complaints(printed):
    """Raise if a command that succeeded printed a traceback or a warning of Python."""
    if COMPLAINT.search(printed):
        raise SystemExit("bare machine: a command complains")


def pip_places():
    """Return where pip keeps what it downloaded, and the configuration of this user, who has another home there."""
    words = (sys.executable, "-m", "pip", "cache", "dir")
    cache = subprocess.run(words, check=True, capture_output=True, text=True).stdout.strip()
    config = Path.home() / ".config" / "pip" / "pip.conf"
    own = {"PIP_CONFIG_FILE": str(config)} if config.is_file() else {}
    return own | {"PIP_CACHE_DIR": cache}


def asking_tests(folder):
    """Return the files of tests that ask for a program, or for the package that is broken there."""
    files = sorted(folder.rglob("test_*.py"))
    return [file for file in files if ASKS.search(file.read_text("utf-8"))]


def unpacked_source(folder):
    """Build the source archive, and return the folder that it unpacks to."""
    words = (sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", folder)
    subprocess.run(words, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    (archive,) = folder.glob("*.tar.gz")
    shutil.unpack_archive(archive, folder)
    return archive.with_name(archive.name.removesuffix(".tar.gz"))


def main():
    """Run both commands; an error ends it."""
    with tempfile.TemporaryDirectory(prefix="collalign-bare-") as folder:
        place = Path(folder)
        machine, source = BareMachine(place), unpacked_source(place)
        words = ("bash", "-euc", command("demo", README.read_text("utf-8")))
        refuse_complaints(machine.run(*words, folder=source))
        if not (source / "collalign-demo" / "aligned" / "report.html").is_file():
            raise SystemExit("bare machine: the demonstration wrote no report")
        files = asking_tests(ROOT / "tests")
        machine.run(sys.executable, "-m", "pytest", "-n", "2", "-rs", *files, folder=ROOT)


if __name__ == "__main__":
    main()
