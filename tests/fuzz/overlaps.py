"""Every command with its output in every way over, in or around its input: nothing of the user's is lost."""

import dataclasses
import io
import itertools
import os
import shutil
import subprocess
import tempfile
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np

from collalign.cli import main
from collalign.output.loading import load
from data_tools.io.listing import read_folder
from tests.view_problems import write_result

FEW = ["--sampling.num-points", "16", "--sampling.num-dense-points", "0", "--jobs", "1"]
PAIR = ["meshes/chair1.ply", "meshes/chair2.ply"]
#: Commands of a project with shapes in ``meshes`` and their result in ``out``; {} is where they are told to write.
COMMANDS = {
    "align": ["align", "meshes", "--out", "{}", *FEW],
    "batch": ["batch", "batch.toml", "--jobs", "1"],
    "demo": ["demo", "--num-shapes", "2", "--out", "{}", *FEW],
    "match": ["match", *PAIR, "--out", "{}", "--no-refine", *FEW[:4]],
    "match --partial": ["match", *PAIR, "--out", "{}", "--partial", *FEW[:4]],
    "match --nonrigid": ["match", *PAIR, "--out", "{}", "--nonrigid"],
    "variation": ["variation", "out", "--to", "{}", "--jobs", "1"],
    "transfer": ["transfer", "out", "--landmarks", "chair1.csv", "--to", "{}", "--jobs", "1"],
    **{
        f"export {f}": ["export", "out", "--format", f, "--to", "{}"]
        for f in ("csv", "ply", "shapeworks", "itk", "tps")
    },
    "add": ["add", "{}", "new", "--jobs", "1"],
    "add from": ["add", "out", "{}", "--jobs", "1"],
    "stability": [
        "stability",
        "{}",
        "--num-points",
        "12",
        "--num-seeds",
        "0",
        "--num-subsets",
        "0",
        "--jobs",
        "1",
    ],
    "certify": ["certify", "{}", "--jobs", "1"],
}
#: The commands whose place is a result: it is moved or copied there first.
ON_RESULTS = ("add", "stability", "certify")
#: Where the output is told to be, in a project; ``linked`` and ``mounted`` lead to ``meshes``.
PLACES = (
    "meshes", "meshes/new", "meshes/a/b", ".", "..", "meshes/..", "meshes/../meshes", "linked", "linked/new",
    "mounted", "mounted/new", "out", "out/meshes", "out/new", "new", "new/x",
    "apart/inner", "apart/hard", "apart/mine",
)  # fmt: skip


def cases():
    """Every command with every place."""
    return list(itertools.product(COMMANDS, PLACES))


def overlap_endings(template, num, *, seed=0):
    """Run ``num`` of the cases, drawn without repetition, and yield what became of the user's files in each."""
    for at in np.random.default_rng(seed).permutation(len(cases()))[:num]:
        command, place = cases()[at]
        yield f"{command} in {place}", run_case(template, command, place)


def run_case(template, command, place):
    """Return "refused" or "done" where all is well, else what was lost or mixed in."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        project = Path(folder) / "project"
        shutil.copytree(template, project)
        if place.startswith("mounted") and not stack.enter_context(
            mounted(project / "meshes", project / "mounted")
        ):
            return "cannot be mounted"
        _prepare(project, command, place)
        before = _mine(project)
        inputs = ("meshes", "new") if command == "add" else ("meshes",)
        names = {given: set(read_folder(project / given).names) for given in inputs}
        words = [word.replace("{}", place) for word in COMMANDS[command]]
        code, said = _run(words, project)
        if code not in (0, 2, 3):
            return f"ends with {code}: {said[-300:]}"
        after = _mine(project)
        lost = [name for name, data in before.items() if after.get(name) != data]
        mixed = [
            given
            for given, known in names.items()
            if set(read_folder(project / given).names) != known
        ]
        if lost or mixed:
            return f"lost {lost}" if lost else f"mixed into {mixed}"
        return "refused" if code == 2 else "done"


@contextmanager
def mounted(source, target):
    """Mount a folder at a second place, where this system allows it."""
    target.mkdir()
    command = shutil.which("mount")
    done = (
        command
        and subprocess.run([command, "--bind", source, target], capture_output=True).returncode == 0
    )
    try:
        yield bool(done)
    finally:
        if done:
            subprocess.run(["umount", str(target)], check=True)


def _prepare(project, command, place):
    """Point the result at the project's shapes, and lay out the folders that a case names."""
    files = tuple(str(project / "meshes" / f"chair{at}.ply") for at in (1, 2, 3))
    write_result(dataclasses.replace(load(project / "out"), files=files), project / "out")
    (project / "linked").symlink_to("meshes")
    (project / "new").mkdir()
    shutil.copy(project / "meshes" / "chair1.ply", project / "new" / "chair9.ply")
    (project / "chair1.csv").write_text("tip,0,0,0\n")
    options = "[options.sampling]\nnum_points = 16\nnum_dense_points = 0\n"
    (project / "batch.toml").write_text(f'{options}[[jobs]]\nfolder = "meshes"\nout = "{place}"\n')
    makers = {
        "apart/inner": lambda to: [
            (to / name).symlink_to(project / "meshes") for name in ("meshes", "specimens", "shapes")
        ],
        "apart/hard": lambda to: [
            os.link(project / "meshes" / "chair1.ply", to / name)
            for name in ("chair1.ply", "match.json")
        ],
        "apart/mine": lambda to: [
            (to / name).write_text("mine")
            for name in ("report.html", "landmarks.csv", "map.npz", "stability.csv")
        ],
    }
    if place in makers:
        (project / place).mkdir(parents=True)
        makers[place](project / place)
    if command in ON_RESULTS and place not in ("out", ".", "..", "meshes/.."):
        shutil.copytree(project / "out", project / place, dirs_exist_ok=True)


def _mine(project):
    """Read what no command wrote: inputs, lists, and files that were put in the way."""
    inputs = [
        *(project / "meshes").glob("*"),
        *(project / "new").glob("*"),
        *project.glob("*.*"),
        *project.glob("apart/*/*"),
    ]
    return {
        str(path.relative_to(project)): path.read_bytes()
        for path in inputs
        if path.is_file() and path.name != "store.sqlite"
    }


def _run(words, folder):
    text, back = io.StringIO(), Path.cwd()
    os.chdir(folder)
    try:
        with redirect_stdout(text), redirect_stderr(text):
            return main(words), text.getvalue()
    except BaseException as error:
        return -1, f"{type(error).__name__}: {error}"
    finally:
        os.chdir(back)
