"""Every bash and python block of the documentation runs, in order; `console` and `py` blocks need a cluster."""

import inspect
import json
import os
import pkgutil
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

import collalign
import pairwise
from collalign.cli import main

pytestmark = pytest.mark.usefixtures("quick_search")
ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
BLOCK = re.compile(r"^```(bash|python)\n(.*?)^```", re.DOTALL | re.MULTILINE)
#: The public modules of collalign.
FACES = [
    one for one in (getattr(collalign, name) for name in collalign.__all__) if inspect.ismodule(one)
]
#: What only a shell understands.
SHELL_SYNTAX = re.compile(r"""[|&;<>$`*?\\#'"]""")


def run_page(text, folder, monkeypatch):
    """Run the bash and python blocks of a page in order and return how many there were."""
    monkeypatch.chdir(folder)
    names = {"__name__": "page"}
    blocks = BLOCK.findall(text)
    for language, code in blocks:
        if language == "python":
            exec(compile(code, "page", "exec"), names)
        elif (commands := plain_commands(code)) is None:
            path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
            environment = {**os.environ, "PATH": path, "OPENBLAS_NUM_THREADS": "1"}
            subprocess.run(
                ["bash", "-euc", code],
                check=True,
                env=environment,
                capture_output=True,
                timeout=600,
            )
        else:
            for words in commands:
                exit_code = main(words)
                if exit_code != 0:
                    raise subprocess.CalledProcessError(exit_code, words)
    return len(blocks)


def plain_commands(code):
    """Return the arguments of each line where all are calls of collalign that need no shell; None otherwise.

    They run in this process: most of a small command's time is the start of Python and of its workers.
    """
    lines = [line.split() for line in code.splitlines() if line.strip()]
    if SHELL_SYNTAX.search(code) or not all(words[0] == "collalign" for words in lines):
        return None
    return [words[1:] for words in lines]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_block_runs(page, tmp_path, monkeypatch):
    run_page(page.read_text("utf-8"), tmp_path, monkeypatch)


@pytest.mark.parametrize(
    "notebook", sorted((ROOT / "docs").rglob("*.ipynb")), ids=lambda page: page.stem
)
def test_every_notebook_runs(notebook, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("webbrowser.open", lambda address: None)
    names = {"__name__": "notebook"}
    cells = json.loads(notebook.read_text("utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert code
    for source in code:
        exec(compile(source, notebook.name, "exec"), names)


def test_a_wrong_block_is_noticed(tmp_path, monkeypatch):
    with pytest.raises(AssertionError):
        run_page("```python\nassert 1 == 2\n```\n", tmp_path, monkeypatch)
    for wrong in ("collalign align nowhere --out out", "true\nfalse"):
        with pytest.raises(subprocess.CalledProcessError):
            run_page(f"```bash\n{wrong}\n```\n", tmp_path, monkeypatch)
    assert run_page("```text\nanything\n```\n", tmp_path, monkeypatch) == 0


def test_navigation_has_every_page():
    navigation = (ROOT / "mkdocs.yml").read_text("utf-8")
    for page in PAGES:
        assert str(page.relative_to(ROOT / "docs")) in navigation


def reference_names(pages="*"):
    """Return the names that pages of the reference show, in their order."""
    return [
        name
        for page in sorted((ROOT / "docs" / "reference").glob(f"{pages}.md"))
        for name in re.findall(r"^::: (.+)$", page.read_text("utf-8"), re.MULTILINE)
    ]


def home(one):
    """Return the module that something public is from; of a module, itself."""
    return str(getattr(one, "__module__", getattr(one, "__name__", "")))


def test_the_reference_has_every_public_name_once():
    shown = reference_names()
    assert len(shown) == len({*shown})
    objects = [pkgutil.resolve_name(name) for name in shown]
    modules = {one.__name__ for one in objects if isinstance(one, ModuleType)}
    for face in (collalign, pairwise, *FACES):
        public = {name: getattr(face, name) for name in {*face.__all__} - {"__version__"}}
        missing = [
            name
            for name, one in public.items()
            if not isinstance(one, ModuleType) and one not in objects and home(one) not in modules
        ]
        assert not missing


@pytest.mark.parametrize(
    "page",
    [
        *PAGES,
        *(
            ROOT / name
            for name in ("README.md", "CONTRIBUTING.md", "RESULTS.md", "packaging/README.md")
        ),
    ],
    ids=lambda page: page.stem,
)
def test_links_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text("utf-8")):
        assert (page.parent / link).exists(), link


#: What a reader may look up: pages, notebooks, and the integrations.
NAMING = [
    *PAGES,
    *(ROOT / name for name in ("README.md", "CHANGELOG.md", "RESULTS.md", "paper/paper.md")),
    *sorted((ROOT / "docs").rglob("*.ipynb")),
    *sorted(
        one for one in (ROOT / "integrations").rglob("*") if one.suffix in (".md", ".py", ".R")
    ),
]


def unknown_names(text):
    """Return the names of the packages in a text, with dots or imported from modules, that are not there."""
    names = re.findall(r"\b((?:collalign|pairwise|data_tools)(?:\.[A-Za-z_]\w*)+)", text)
    for module, imported in re.findall(r"from (collalign[\w.]*|pairwise) import ([\w, ]+)", text):
        names += [f"{module}.{name.split()[0]}" for name in imported.split(",")]
    return sorted({name for name in names if not name.endswith(".md") and not is_there(name)})


def is_there(name):
    try:
        pkgutil.resolve_name(name)
    except (AttributeError, ImportError):
        return False
    return True


@pytest.mark.parametrize("page", NAMING, ids=lambda page: page.name)
def test_names_in_documents_are_those_of_the_code(page):
    assert unknown_names(page.read_text("utf-8")) == []


def test_an_old_name_is_noticed():
    text = "`collalign.Note`, collalign.load, from collalign import match_shapes, load\n"
    assert unknown_names(text) == ["collalign.Note", "collalign.match_shapes"]


def unknown_numbers(page):
    """Return the rows of the page on numbers whose module has no such name."""
    rows = re.findall(r"^\| `([\w.]+)` \| `([\w, .]+)` \|", page, re.MULTILINE)
    sources = {module: inspect.getsource(import_module(module)) for module, _ in rows}
    return [
        (module, name)
        for module, names in rows
        for name in names.split(", ")
        if name != "module" and name.rpartition(".")[2] not in sources[module]
    ]


def test_numbers_of_the_page_are_those_of_the_code():
    page = (ROOT / "experiments" / "calibration" / "numbers.md").read_text("utf-8")
    assert unknown_numbers(page) == []
    changed = page.replace("COPIES_TOL", "NO_TOL")
    assert unknown_numbers(changed) == [("data_tools.embedding.copies", "NO_TOL")]
