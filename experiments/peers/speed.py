"""CPU time and memory of what users run, and of peers on the same files: each run is a process of one thread."""

from __future__ import annotations

import importlib.metadata
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from collalign.engine.records import Record
from collalign.output.loading import load
from data_tools.arrays import FloatArray
from data_tools.datasets.synthetic import write_collection
from data_tools.errors import CollectionError, InputError
from data_tools.io.shapes import write_mesh
from experiments.collections.landmarked import TEETH_FOLDER, read_dataset
from experiments.collections.posed import GROSS_DEG, PosedCollection, pose_collection
from experiments.confidence.families import Family, pose_family
from experiments.datasets import read_truth_folder
from experiments.experiment import Bench, Cell, Experiment, Outcome
from experiments.figures.planted import planted_problem
from experiments.generated.assembled import assembled_objects
from experiments.importable import is_importable
from experiments.maps.map_sets import ANIMALS, read_map_set
from experiments.peers.bones import bones, peak_gib
from experiments.peers.peer_tools import TOOLS
from experiments.provenance import ROOT, code_digest
from experiments.tables import Column, Row, Table, Value
from pairwise.options import BUILT_IN
from pairwise.relaxations import solve_pm_sdp
from pairwise.results import Status

#: Runs of each line; its figures are the medians.
NUM_RUNS = 3
#: Landmarks of each of the specimens that are carried to each other.
NUM_CARRIED, NUM_MARKS = 24, 19
#: Points of the problems that PM-SDP is solved for, and after how many seconds a solver is stopped.
PM_SDP_SIZES, STOPPED_S = (20, 50, 100), 120.0
#: How often the memory of a process is looked at, in seconds.
LOOK_S = 0.02
#: Gap asked of the built-in solver and tolerance of the others, and for how many points each is run at most.
GAPS = {BUILT_IN: 4e-6, "scs": 1e-4, "clarabel": None}
MOST_POINTS = {BUILT_IN: 100, "scs": 50, "clarabel": 20}

_ABOUT = f"""
CPU time (user and system) of what users run, each run in a process of its own with one thread: imports count, and
reading and writing files. Other tools get the same files and one thread. They end with rotations and write nothing.
Figures are medians of {NUM_RUNS} runs, one after the other. Other work on the machine makes CPU time up to 30 %
longer, so compare lines of one run only. Modules are compiled once, as installers compile them. *Memory* is the
largest of a process and its workers. *Gross* are the pairs off by more than {GROSS_DEG:.0f} degrees or of the wrong
side: a faster answer that differs is another answer.

* `align` runs with default options and one worker.
* `transfer` carries {NUM_MARKS} landmarks of each of {NUM_CARRIED} skulls to all others. `variation` takes 50 skulls.
  What aligned them before is not counted.
* PM-SDP is solved for uniform points in the unit cube with noise .1, as published. SCS is run up to
  {MOST_POINTS["scs"]} points and Clarabel up to {MOST_POINTS["clarabel"]}; both are stopped after {STOPPED_S:.0f} s.
* *Installed* is the size of the toolkit and of all that it requires.
* The test command of the README runs once. It takes wall time and all cores, and says nothing while the machine has
  other work.
"""


class Spent(NamedTuple):
    """CPU time and wall time in seconds, and the largest memory of a process with its children in MiB."""

    processor_s: float
    wall_s: float
    memory_mib: float


def run_fresh(command: Iterable[str], *, threads: int | None = 1) -> Spent:
    """Run a command and return what it took, with all processes that it started and waited for.

    Parameters
    ----------
    command : iterable of str
    threads : int or None
        Threads of numerical libraries; None leaves them as they are.

    Raises
    ------
    CollectionError
        With the end of what it printed, if it failed.
    """
    words = list(command)
    limits = {
        f"{name}_NUM_THREADS": str(threads)
        for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")
        if threads is not None
    }
    limits["PYTHONDONTWRITEBYTECODE"] = ""  # what is installed has its bytecode beside it
    with tempfile.TemporaryFile() as said:
        began_s = time.perf_counter()
        process = subprocess.Popen(
            words, cwd=ROOT, env=os.environ | limits, stdout=said, stderr=subprocess.STDOUT
        )
        ended, peak = 0, 0.0
        while not ended:
            # What the kernel reports at the end is at least the memory of the process that started it.
            with suppress(OSError, StopIteration):
                peak = max(peak, peak_gib(process.pid))
            time.sleep(LOOK_S)
            ended, status, usage = os.wait4(process.pid, os.WNOHANG)
        wall_s = time.perf_counter() - began_s
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            said.seek(0)
            end = said.read().decode(errors="replace")[-500:]
            raise CollectionError(f"{' '.join(words)} ended with {process.returncode}: {end}")
    return Spent(usage.ru_utime + usage.ru_stime, wall_s, 1024.0 * peak)


def _collalign(*words: object) -> Spent:
    return run_fresh([sys.executable, "-m", "collalign", *map(str, words)])


def _align(folder: Path, out: Path) -> Spent:
    return _collalign("align", folder, "--out", out, "--jobs", 1, "--quiet")


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A collection in random poses: how it is drawn, and the folder of the data that it needs."""

    draw: Callable[[Path, Path, bool], PosedCollection]
    needs: str = ""


def _bones(data: Path, folder: Path, quick: bool) -> PosedCollection:
    planted = bones(1_000 if quick else 18_000, 4 if quick else 50)
    write_collection(folder, planted)
    relative = np.einsum("ica,jcb->ijab", planted.rotations, planted.rotations)
    names = tuple(shape.name for shape in planted.shapes)
    return PosedCollection(folder=folder, names=names, relative=relative)


def _dataset(name: str, num: int, data: Path, folder: Path, quick: bool) -> PosedCollection:
    dataset, rng = read_dataset(name, data), np.random.default_rng(0)
    return pose_collection(dataset, rng.permutation(len(dataset))[:num], folder, rng)


def _frames(data: Path, folder: Path, quick: bool) -> PosedCollection:
    dataset, rng = read_truth_folder(data / "depth_room20"), np.random.default_rng(0)
    return pose_collection(dataset, np.arange(len(dataset)), folder, rng)


def _chairs(num: int, data: Path, folder: Path, quick: bool) -> PosedCollection:
    family = Family(members=lambda count, rng: assembled_objects("chairs", count, rng))
    return pose_family(family, 4 if quick else num, folder, np.random.default_rng(0))


#: The collections that are aligned, by the names of their lines.
ALIGNED: dict[str, Drawn] = {
    "50 generated bones of 18 000 vertices": Drawn(draw=_bones),
    "116 teeth": Drawn(draw=partial(_dataset, "teeth", 116), needs=TEETH_FOLDER),
    "20 bodies that bend": Drawn(draw=partial(_dataset, "scape", 20), needs="scape71"),
    "20 depth images": Drawn(draw=_frames, needs="depth_room20"),
    "12 assembled chairs": Drawn(draw=partial(_chairs, 12)),
    "1000 assembled chairs": Drawn(draw=partial(_chairs, 1000)),
}
#: Other tools that align a collection too.
PEERS = {"50 generated bones of 18 000 vertices": ("open3d",)}
#: What these lines are to take, in CPU seconds; a share where it is compared with a peer.
GOALS = {
    "50 generated bones of 18 000 vertices": ".5 of Open3D",
    "116 teeth": "40 s",
    "20 bodies that bend": "35 s",
    "20 depth images": "40 s",
    "12 assembled chairs": "15 s",
    "1000 assembled chairs": "60 s, 700 MiB",
    "match --nonrigid": "3 s",
    "transfer": "50 s",
    "variation": "70 s",
    "import collalign": ".02 s",
    "collalign --help": ".2 s",
    "installed": "650 MiB",
    "PM-SDP of 20 points": ".08 s",
    "PM-SDP of 50 points": ".3 s",
    "PM-SDP of 100 points": "2 s",
    "tests, two workers": "240 s of wall time",
    "installation": "45 s of wall time",
}
#: Writes the rotations of a tool; run in a process of its own.
_PEER_SCRIPT = """
import sys
from pathlib import Path
import numpy as np
from experiments.peers.peer_tools import TOOLS
for answer in TOOLS[sys.argv[1]].align(Path(sys.argv[2]), False, 1).values():
    np.savez(sys.argv[3], rotations=answer.rotations, names=np.array(answer.names))
"""


def measure_alignment(cell: Cell) -> Record:
    """Align a collection with a tool. Settings: ``line``, ``tool``, ``quick``, ``run``, ``code``."""
    settings = cell.settings
    with tempfile.TemporaryDirectory() as text:
        folder, out = Path(text) / "files", Path(text) / "out"
        folder.mkdir()
        posed = ALIGNED[settings["line"]].draw(cell.data, folder, settings["quick"])
        if settings["tool"] == "collalign":
            spent = _align(folder, out)
            found = load(out)
            rotations: FloatArray = found.rotations
            names = list(found.names)
        else:
            file = Path(text) / "found.npz"
            spent = run_fresh(
                [sys.executable, "-c", _PEER_SCRIPT, settings["tool"], str(folder), str(file)]
            )
            with np.load(file) as archive:
                rotations, names = archive["rotations"], archive["names"].tolist()
    figures = posed.figures(rotations, names)
    wrong = {"gross": figures["gross"] + figures["mirrored"], "median_deg": figures["median_deg"]}
    return spent._asdict() | wrong


def _two_cats(data: Path, folder: Path) -> Spent:
    cats = read_map_set(data, ANIMALS).data
    for i in range(2):
        write_mesh(folder / f"{i}.ply", cats.shape(i))
    ends = [folder / "0.ply", folder / "1.ply"]
    return _collalign("match", *ends, "--nonrigid", "--out", folder / "map")


def _skulls(num: int, data: Path, folder: Path) -> Path:
    """Align skulls, with landmarks beside them, and return the folder of the result."""
    dataset = read_dataset("mouse skulls", data)
    (files := folder / "files").mkdir()
    (marks := folder / "marks").mkdir()
    for i in range(num):
        shape = dataset.shape(i)
        write_mesh(files / f"{shape.name}.ply", shape)
        if dataset.landmarks is not None:
            rows = dataset.landmarks[i, :NUM_MARKS]
            lines = [f"{k},{x},{y},{z}" for k, (x, y, z) in enumerate(rows.tolist())]
            (marks / f"{shape.name}.csv").write_text("\n".join(["label,x,y,z", *lines]))
    _align(files, folder / "out")
    return folder / "out"


def _transfer(data: Path, folder: Path) -> Spent:
    out = _skulls(NUM_CARRIED, data, folder)
    marks = sorted((folder / "marks").iterdir())
    to = ("--to", folder / "carried", "--jobs", 1)
    return _collalign("transfer", out, "--landmarks", *marks, "--leave-one-out", *to)


def _variation(data: Path, folder: Path) -> Spent:
    out = _skulls(50, data, folder)
    return _collalign("variation", out, "--to", folder / "variation")


def _import(data: Path, folder: Path) -> Spent:
    return run_fresh([sys.executable, "-c", "import collalign"])


def _help(data: Path, folder: Path) -> Spent:
    return _collalign("--help")


def _tests(data: Path, folder: Path) -> Spent:
    return run_fresh([sys.executable, "-m", "pytest", "-n", "2"], threads=None)


def _installation(data: Path, folder: Path) -> Spent:
    run_fresh([sys.executable, "-m", "venv", str(folder / "venv")])
    pip = [str(folder / "venv" / "bin" / "python"), "-m", "pip", "install", "-q"]
    return run_fresh([*pip, "-e", f"{ROOT}[test]"], threads=None)


#: Commands that are measured as they are, and the folder of the data that each needs.
COMMANDS: dict[str, tuple[Callable[[Path, Path], Spent], str]] = {
    "match --nonrigid": (_two_cats, "tosca_cat_dog"),
    "transfer": (_transfer, "mouse_skulls62"),
    "variation": (_variation, "mouse_skulls62"),
    "import collalign": (_import, ""),
    "collalign --help": (_help, ""),
    "tests, two workers": (_tests, ""),
    "installation": (_installation, ""),
}
#: Lines that run once: they take long, or the network decides.
ONCE = ("1000 assembled chairs", "tests, two workers", "installation")


def measure_command(cell: Cell) -> Record:
    """Run a command. Settings: ``line``, ``run``, ``code``."""
    with tempfile.TemporaryDirectory() as folder:
        return COMMANDS[cell.settings["line"]][0](cell.data, Path(folder))._asdict()


def measure_relaxation(cell: Cell) -> Record:
    """Solve PM-SDP in this process. Settings: ``num`` points, ``solver``, ``run``, ``code``.

    Returns
    -------
    dict
        ``processor_s``; infinite where the solver was stopped.
    """
    num, solver = cell.settings["num"], cell.settings["solver"]
    solve = partial(solve_pm_sdp, row_sums=False, solver=solver, time_limit_s=STOPPED_S)
    rng = np.random.default_rng(0)
    solve(planted_problem(rng, 5, 5, 3), tol=GAPS[solver])  # what it imports does not count
    problem = planted_problem(np.random.default_rng(cell.settings["run"]), num, num, 3)
    began_s = time.process_time()
    found = solve(problem, tol=GAPS[solver])
    spent_s = time.process_time() - began_s
    return {"processor_s": float("inf") if found.status is Status.TIME_LIMIT else spent_s}


def installed_mib(name: str) -> float:
    """Return the size of a distribution and of all that it requires, of the packages that are installed."""
    waiting, seen, size = [name], set[str](), 0
    while waiting:
        one = waiting.pop()
        if (key := re.sub(r"[-_.]+", "-", one).lower()) in seen:
            continue
        seen.add(key)
        try:
            distribution = importlib.metadata.distribution(one)
        except importlib.metadata.PackageNotFoundError:  # of another system, or optional
            continue
        if one == name:
            packages = (ROOT / package for package in ("collalign", "pairwise", "data_tools"))
            files = (file for package in packages for file in package.rglob("*") if file.is_file())
            size += sum(f.stat().st_size for f in files if "node_modules" not in f.parts)
        else:
            paths = (Path(str(file.locate())) for file in distribution.files or ())
            size += sum(path.stat().st_size for path in paths if path.is_file())
        wanted = (need for need in distribution.requires or () if "extra ==" not in need)
        waiting += [re.split(r"[^\w.-]", need)[0] for need in wanted]
    return size / 2**20


COLUMNS = (
    Column(key="line", title="what runs"),
    Column(key="tool", title="tool"),
    Column(key="runs", title="runs"),
    Column(key="processor_s", title="CPU, s", format=".2f", clock=True),
    Column(key="wall_s", title="wall, s", format=".1f", clock=True),
    Column(key="memory_mib", title="memory, MiB", format=".0f", clock=True),
    Column(key="gross", title="gross pairs"),
    Column(key="median_deg", title="median, deg", format=".2f"),
    Column(key="goal", title="goal"),
)


def _row(line: str, tool: str, records: list[Record]) -> Row:
    """Return the medians of some runs; what a line does not have stays empty."""
    keys = [column.key for column in COLUMNS if column.key in records[0]]
    figures: dict[str, Value] = {k: float(np.median([one[k] for one in records])) for k in keys}
    if "gross" in keys:
        figures["gross"] = int(np.median([one["gross"] for one in records]))
    goal = GOALS[line] if tool == "collalign" else ""
    return {**figures, "line": line, "tool": tool, "runs": len(records), "goal": goal}


def measure(bench: Bench) -> Outcome:
    """Measure every line that is wanted and whose data and tools are here, one run after the other.

    Raises
    ------
    InputError
        If ``bench.only`` names a line that there is not.
    """
    if unknown := [line for line in bench.only if line not in GOALS]:
        raise InputError(f"--only: no line is called {unknown[0]!r}; there are {', '.join(GOALS)}")
    code, lacking = code_digest(ROOT), [line for line in GOALS if not bench.wants(line)]
    rows: list[Row] = []

    def add(
        function: Callable[[Cell], Record], line: str, tool: str, settings: dict[str, Any]
    ) -> None:
        runs = range(1 if bench.quick or line in ONCE else NUM_RUNS)
        cells = {f"{line}, {tool}, run {run}": settings | {"run": run} for run in runs}
        found = bench.measure(function, cells, apart=True)
        rows.append(_row(line, tool, list(found.values())))

    for line, drawn in ALIGNED.items():
        if not bench.wants(line):
            continue
        if (bench.quick and drawn.needs) or (
            drawn.needs and not (bench.data / drawn.needs).is_dir()
        ):
            lacking.append(line)
            continue
        for tool in ("collalign", *PEERS.get(line, ())):
            if TOOLS[tool].lacks():
                lacking.append(f"{line} with {TOOLS[tool].lacks()}")
                continue
            settings = {"line": line, "tool": tool, "quick": bench.quick, "code": code}
            add(measure_alignment, line, tool, settings)
    for line, (_, needs) in COMMANDS.items():
        if not bench.wants(line):
            continue
        if (bench.quick and (needs or line in ONCE)) or (
            needs and not (bench.data / needs).is_dir()
        ):
            lacking.append(line)
            continue
        add(measure_command, line, "collalign", {"line": line, "code": code})
    for num in PM_SDP_SIZES[:1] if bench.quick else PM_SDP_SIZES:
        line = f"PM-SDP of {num} points"
        for solver in (one for one in GAPS if num <= MOST_POINTS[one] and bench.wants(line)):
            if solver != BUILT_IN and not (is_importable("cvxpy") and is_importable(solver)):
                lacking.append(f"PM-SDP with {solver}")
                continue
            tool = "collalign" if solver == BUILT_IN else solver
            settings = {"num": num, "solver": solver, "code": code}
            add(measure_relaxation, line, tool, settings)
    if bench.wants(line := "installed"):
        size, goal = installed_mib("collalign"), GOALS[line]
        rows.append(
            {"line": line, "tool": "collalign", "runs": 1, "memory_mib": size, "goal": goal}
        )
    text = f"The code of this page has the digest `{code}`."
    text += f" Not measured here: {'; '.join(lacking)}." if lacking else ""
    return Outcome(tables=(Table(columns=COLUMNS, rows=tuple(rows)),), text=text)


EXPERIMENT = Experiment(
    name="speed",
    title="CPU time and memory, beside other tools",
    about=_ABOUT,
    measure=measure,
    seen=("teeth", "scape"),
    has_lines=True,
)
