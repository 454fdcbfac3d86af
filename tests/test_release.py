"""What makes a release, checked as far as it can be without a forge, conda or Docker."""

import re
import tomllib
from pathlib import Path

import numpy as np
import yaml

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
RECIPE = yaml.safe_load((ROOT / "packaging" / "conda" / "recipe.yaml").read_text("utf-8"))
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
#: Packages that conda-forge calls otherwise; without their optional parts.
CONDA_NAMES = {"matplotlib": "matplotlib-base", "msgpack": "msgpack-python"}


def faults(workflow):
    """Return the jobs that a forge would refuse: no machine or steps, unknown needs, workflows that are not there."""
    jobs = workflow["jobs"]
    steps = [(name, step) for name, job in jobs.items() for step in job.get("steps", [])]
    said = [
        name
        for name, job in jobs.items()
        if "uses" not in job and not ("runs-on" in job and job.get("steps"))
    ]
    said += [
        name for name, job in jobs.items() if {*np.atleast_1d(job.get("needs", []))} - jobs.keys()
    ]
    said += [name for name, step in steps if ("uses" in step) == ("run" in step)]
    return said + [
        name for name, job in jobs.items() if "uses" in job and not (ROOT / job["uses"]).exists()
    ]


def test_workflows_are_whole():
    for path in WORKFLOWS:
        workflow = yaml.safe_load(path.read_text("utf-8"))
        assert workflow[True], "YAML reads ``on``, what starts it, as true"
        assert faults(workflow) == [], path
    broken = {
        "a": {"needs": "b", "runs-on": "x", "steps": [{"name": "nothing"}]},
        "c": {},
        "d": {"uses": "./no.yml"},
    }
    assert faults({"jobs": broken}) == ["c", "a", "a", "d"]


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
    assert set(RECIPE["requirements"]["run"]) == expected | {f"python {PROJECT['requires-python']}"}
    assert len(expected) == len(PROJECT["dependencies"])


def test_the_tests_install_what_the_features_of_users_need():
    """The extras that the documentation tells users to install; ``peers`` are for measurements."""
    extras = PROJECT["optional-dependencies"]
    wanted = {text for name in ("app", "cvxpy", "dask", "parquet") for text in extras[name]}
    assert wanted <= {*extras["test"]}


def test_one_version_everywhere():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    package = yaml.safe_load((ROOT / "integrations" / "r" / "DESCRIPTION").read_text("utf-8"))
    assert {RECIPE["context"]["version"], citation["version"], package["Version"]} == {
        PROJECT["version"]
    }


def test_the_extension_carries_the_licence_of_the_project():
    extension = ROOT / "integrations" / "slicer"
    assert (extension / "LICENSE.txt").read_bytes() == (ROOT / "LICENSE").read_bytes()
    assert not re.search(r"project\(Slicer", (extension / "CMakeLists.txt").read_text("utf-8"))


def test_the_image_copies_what_there_is_and_what_is_not_ignored():
    kept = {
        line[1:]
        for line in (ROOT / ".dockerignore").read_text("utf-8").splitlines()
        if line.startswith("!")
    }
    copied = re.findall(
        r"^COPY (?!--from)(.+) \S+$",
        (ROOT / "packaging" / "Dockerfile").read_text("utf-8"),
        re.MULTILINE,
    )
    names = {name for line in copied for name in line.split()}
    assert names == kept
    assert all((ROOT / name).exists() for name in names)


def test_the_paper_cites_what_is_listed_and_lists_what_it_cites():
    text = (ROOT / "paper" / "paper.md").read_text("utf-8")
    listed = re.findall(
        r"^@\w+\{(\w+),", (ROOT / "paper" / "paper.bib").read_text("utf-8"), re.MULTILINE
    )
    assert sorted(set(re.findall(r"@([a-z]+\d{4})", text))) == sorted(listed)
    for picture in re.findall(r"!\[[^]]*\]\(([^)]+)\)", text):
        assert (ROOT / "paper" / picture).exists()


def test_claims_of_the_paper_name_experiments_that_were_measured():
    text, results = ((ROOT / name).read_text("utf-8") for name in ("paper/paper.md", "RESULTS.md"))
    named = set(
        re.findall(
            r"`(?:python -m experiments )?([a-z_]+)`", text.partition("# Reproducible claims")[2]
        )
    )
    assert len(named) > 6
    assert {name for name in named if f"`python -m experiments {name}`" not in results} == set()
