"""What makes a release, checked as far as it can be without a forge, conda or Docker."""

import re
import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
RECIPE = yaml.safe_load((ROOT / "packaging" / "conda" / "recipe.yaml").read_text("utf-8"))
#: Packages that conda-forge calls otherwise; without their optional parts.
CONDA_NAMES = {"matplotlib": "matplotlib-base", "msgpack": "msgpack-python"}


def test_every_python_that_is_declared_is_tried():
    declared = {
        word.rpartition(" ")[2] for word in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", word)
    }
    for name in ("tests", "wheels"):
        jobs = yaml.safe_load((ROOT / ".github" / "workflows" / f"{name}.yml").read_text("utf-8"))[
            "jobs"
        ]
        (tried,) = [
            job["strategy"]["matrix"]["python"] for job in jobs.values() if "strategy" in job
        ]
        assert set(tried) == declared


def test_the_recipe_asks_for_what_the_wheel_asks_for():
    wanted = [re.fullmatch(r"([\w-]+)(>=.*)", text) for text in PROJECT["dependencies"]]
    expected = {
        f"{CONDA_NAMES.get(found[1], found[1])} {found[2]}" for found in wanted if found is not None
    }
    assert set(RECIPE["requirements"]["run"]) == expected | {"python >=${{ python_min }}"}
    assert PROJECT["requires-python"] == f">={RECIPE['context']['python_min']}"
    assert len(expected) == len(PROJECT["dependencies"])


def test_one_version_everywhere():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    package = yaml.safe_load((ROOT / "integrations" / "r" / "DESCRIPTION").read_text("utf-8"))
    assert {RECIPE["context"]["version"], citation["version"], package["Version"]} == {
        PROJECT["version"]
    }
