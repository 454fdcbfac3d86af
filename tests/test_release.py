"""What makes a release, checked as far as it can be without a forge, conda or Docker."""

import json
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


def missing_fields():
    """Return which fields of files still await a release, an address or a person, by file."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    build = (ROOT / "integrations" / "slicer" / "CMakeLists.txt").read_text("utf-8")
    entry = json.loads((ROOT / "integrations" / "slicer" / "Collalign.json").read_text("utf-8"))
    package = yaml.safe_load((ROOT / "integrations" / "r" / "DESCRIPTION").read_text("utf-8"))
    paper = yaml.safe_load((ROOT / "paper" / "paper.md").read_text("utf-8").split("---")[1])
    nameless = {"name": PROJECT["authors"][0]["name"]}
    found = {
        "CITATION.cff": {"date-released", "doi", "repository-code", "url"} - citation.keys(),
        "pyproject.toml": {"urls"} - PROJECT.keys(),
        "packaging/conda/recipe.yaml": {"url", "sha256"} - RECIPE["source"].keys()
        | {"homepage"} - RECIPE["about"].keys()
        | {"recipe-maintainers"} - RECIPE.get("extra", {}).keys(),
        "integrations/slicer/CMakeLists.txt": set(re.findall(r'set\((\w+) ""\)', build)),
        "integrations/slicer/Collalign.json": {
            name for name, value in entry.items() if value == ""
        },
        "integrations/r/DESCRIPTION": {"email"}
        & {*re.findall(r"\w+(?= = \".+@example)", package["Authors@R"])},
        "paper/paper.md": {"affiliations"}
        if "To be" in paper["affiliations"][0]["name"]
        else set(),
    }
    if citation["authors"] == [nameless]:
        found["CITATION.cff"] |= {"authors"}
    if paper["authors"][0]["name"] == nameless["name"]:
        found["paper/paper.md"] |= {"authors"}
    return {file: fields for file, fields in found.items() if fields}


def listed_fields(text):
    """Return the fields that a document lists as missing, by file; of the paper its metadata alone."""
    rows = re.findall(
        r"^\| `([\w./-]+)` \| (.*) \|$", text.partition("awaits a release")[2], re.MULTILINE
    )
    return {
        file: set(re.findall(r"`([\w-]+)`", words)) - {"Acknowledgements"} for file, words in rows
    }


def test_what_awaits_a_release_is_listed_in_one_place():
    text = (ROOT / "packaging" / "README.md").read_text("utf-8")
    assert listed_fields(text) == missing_fields()
    assert listed_fields(text.replace(", `doi`", "")) != missing_fields()
