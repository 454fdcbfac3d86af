"""CONTRIBUTING.md shows the house as it is: its rooms, the way of a pair, and where something new goes."""

import os
import re
import shutil
import subprocess
import sys
import tomllib

import pytest

from tests.test_layers import ROOT

TEXT = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
#: Folders from which the text names files.
BASES = (
    ROOT,
    *(ROOT / base for base in ("collalign", "collalign/output", "collalign/stages", "collalign/synchronization")),
)


def section(title):
    """The text below a heading, up to the next one."""
    found = re.search(rf"^#+ {title}$(.*?)(?=^#+ )", TEXT, re.MULTILINE | re.DOTALL)
    assert found is not None
    return found.group(1)


def named(text):
    return re.findall(r"`([^`]+)`", text)


def exists(path):
    return any((base / path).exists() for base in BASES)


def defined(name):
    """Whether a module of the project defines the name, or the attribute of a class: ``Class.attribute``."""
    pattern = re.compile(rf"^\s*(def|class) {name.split('.')[-1]}\b|^\s*{name.split('.')[-1]}\b.*[:=]", re.MULTILINE)
    return any(pattern.search(file.read_text("utf-8")) for file in (ROOT / "collalign").rglob("*.py"))


def test_every_room_is_in_the_table_in_the_order_of_its_imports():
    rows = [line.split("|")[1] for line in section("The rooms of collalign").splitlines() if line.startswith("| `")]
    rooms = [re.sub(r"/$|\.py$", "", name) for row in rows for name in named(row)]
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    (layers,) = (one["layers"] for one in contracts if "exhaustive" in one)
    level = {room: at for at, layer in enumerate(reversed(layers)) for room in layer.split(" | ")}
    assert level.keys() == {*rooms}
    listed = [
        level[room] for room in rooms if room in ("engine", "options", "products", "confidence", "stages", "cli")
    ]
    assert listed == sorted(listed)


@pytest.mark.parametrize("path", sorted({name for name in named(TEXT) if re.fullmatch(r"[\w/]+(\.py|/)", name)}))
def test_every_file_and_folder_that_is_named_exists(path):
    assert exists(path) or list((ROOT / "collalign").rglob(path.rstrip("/"))), path


def test_the_way_of_a_pair_goes_through_steps_that_align_takes():
    driver = "".join((ROOT / f"collalign/{n}.py").read_text() for n in ("align", "stages/posing", "stages/steps"))
    steps = [name for name in named(section("The way of a pair")) if re.fullmatch(r"[a-z]+(_[a-z]+)+", name)]
    assert len(steps) > 15
    for step in steps:
        assert defined(step), step
    called = [step for step in steps if f"{step}(" in driver]
    places = [driver.index(f"{step}(") for step in called]
    assert len(called) > 12
    assert places == sorted(places)


def test_the_checks_can_fail():
    assert not exists("collalign/nowhere.py")
    assert exists("tools/export/")
    assert not defined("no_such_function")
    assert defined("match_pair")
    with pytest.raises(AssertionError):
        section("No such heading")


def test_two_workers_share_the_files(tmp_path):
    shutil.copy(ROOT / "tests" / "conftest.py", tmp_path)
    killing = "collalign/engine/test_jobs.py", "collalign/cli/test_main.py"
    for name in ("test_a.py", "test_b.py", *killing):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("import pytest\n@pytest.mark.parametrize('n', range(9))\ndef test_it(n): pass\n")
    command = [sys.executable, "-m", "pytest", "-p", "xdist.plugin", "-n", "2", "-v", "--import-mode=importlib"]
    environment = os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    said = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True).stdout
    found = re.findall(r"\[(gw.)\].* PASSED (.*)::", said)
    workers = {
        name: {worker for worker, one in found if one == name} for name in ("test_a.py", "test_b.py", *killing)
    }
    assert len(found) == 36
    assert all(len(one) == 1 for one in workers.values())
    assert workers[killing[0]] == workers[killing[1]]
