"""The wheel and the source archive hold what they must, and the wheel alone works."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest

from tests.optional import optional_program

ROOT = Path(__file__).resolve().parents[1]
#: What a user's environment holds of the repository: everything of these folders, and nothing else.
PACKAGES = ("collalign", "pairwise", "data_tools")


def run(*words, folder=ROOT):
    """Run a command apart from this checkout's import paths and return what it prints."""
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONPATH", "PYTHONHOME")
    }
    done = subprocess.run(
        words,
        cwd=folder,
        check=False,
        capture_output=True,
        text=True,
        timeout=1200,
        env=environment,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A folder with the source archive, and the wheel that is built from the unpacked source archive."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", folder)
    (archive,) = folder.glob("*.tar.gz")
    shutil.unpack_archive(archive, folder)
    (unpacked,) = (path for path in folder.iterdir() if path.is_dir())
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, folder=unpacked)
    return folder


def listed(*options):
    """Return the files that git lists; skip where there is no version control, as in an unpacked archive."""
    if not (ROOT / ".git").exists():
        pytest.skip("no checkout")
    git = optional_program("git", install="apt-get install git")
    return set(run(git, "-c", f"safe.directory={ROOT}", "ls-files", *options).split("\n")) - {""}


def checked_in():
    """Return the files under version control that are there."""
    return {name for name in listed("--cached") if (ROOT / name).is_file()}


def untracked():
    """Return the files that nobody has checked in, such as results of a command that was tried in the checkout."""
    return listed("--others")


def test_the_source_archive_holds_the_checkout(built):
    (archive,) = built.glob("*.tar.gz")
    with tarfile.open(archive) as packed:
        names = {name.split("/", 1)[1] for name in packed.getnames()}
    assert names - {"PKG-INFO"} - untracked() == checked_in()


def test_the_wheel_holds_the_packages(built):
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as packed:
        names = {name for name in packed.namelist() if ".dist-info/" not in name}
    assert names - untracked() == {
        name for name in checked_in() if name.startswith(tuple(f"{p}/" for p in PACKAGES))
    }


def test_the_wheel_alone_works(built, tmp_path):
    """Its dependencies are borrowed from here; a path in a .pth file does not bring this checkout along."""
    (wheel,) = built.glob("*.whl")
    fresh = tmp_path / "fresh"
    run(sys.executable, "-m", "venv", "--without-pip", fresh)
    python = fresh / "bin" / "python"
    site = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())
    run(
        sys.executable,
        "-m",
        "pip",
        "-q",
        "--python",
        python,
        "install",
        "--no-deps",
        "--no-index",
        wheel,
    )
    (site / "borrowed.pth").write_text(
        f"{sysconfig.get_path('purelib')}\n{sysconfig.get_path('platlib')}\n"
    )
    smoke = tmp_path / "smoke.py"
    smoke.write_text((ROOT / "tests" / "smoke.py").read_text("utf-8"), "utf-8")
    assert "works on Python" in run(python, smoke, tmp_path, folder=tmp_path)


def test_a_checkout_is_no_installation(tmp_path):
    script = f"import runpy, sys; sys.path.insert(0, {str(ROOT)!r}); sys.argv = ['smoke', {str(tmp_path)!r}]; "
    script += f"runpy.run_path({str(ROOT / 'tests' / 'smoke.py')!r}, run_name='__main__')"
    with pytest.raises(AssertionError, match="not from this environment"):
        run(sys.executable, "-c", script)
