"""Forged folders of results for Hypothesis: ``verify`` refuses each, or proves no more of it than is true.

What is true is read from the folder without the verifier: the energy of some arrangement of its samples, which no
lower bound may exceed.
"""

import io
import json
import os
import re
import signal
import zipfile
from contextlib import redirect_stderr, redirect_stdout, suppress

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import collalign
from collalign import AlignOptions, RunOptions
from collalign.cli import main
from collalign.output.verify import verify_result
from data_tools.datasets.synthetic import write_collection
from data_tools.errors import InputError
from data_tools.options import SamplingOptions
from pairwise import Problem
from pairwise.local_search import MatchingCosts, energies_of
from tests.commands import read_json
from tests.finished_runs import chairs
from tests.fuzz.certificates import NOT_FOR_THIS_TYPE, changed, generators

#: What a bound may exceed an energy by, as a share of it, and seconds after which a verifier hangs.
TOL, LIMIT_S = 1e-6, 60
ARCHIVES = ("certificates/problems.npz", "correspondences.npz", "certification.npz")
ALL_ARCHIVES = (*ARCHIVES, *(f"certificates/{pair}.npz" for pair in ("0-1", "0-2", "1-2")))
#: How files end that an earlier change has broken.
BROKEN = (OSError, KeyError, EOFError, zipfile.BadZipFile)
TABLES = ("pairs.csv", "alignment.json", "run.json", ".collalign/manifest.json")
HUGE = ("1e999", "-1e999", "1" + "0" * 400, "nan", "", "0x10", "1e308", "-5", "0")


def honest_result(folder):
    """The result of three chairs in ``meshes``, with certificates of pairs and of the collection, in ``out``."""
    out = folder / "out"
    write_collection(folder / "meshes", chairs(3))
    sampling = SamplingOptions(num_points=8, num_dense_points=50)
    options, run = AlignOptions(sampling=sampling, certify=True, group="SO"), RunOptions(jobs=1)
    collalign.align_collection(folder / "meshes", options=options, run=run, progress=False).save(
        out, report=False
    )
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        main(["certify", str(out), "--jobs", "1"])
    return out


def judge(folder):
    """Return "refused", "true" (all that is proven holds), or what is wrong."""
    signal.signal(signal.SIGALRM, _give_up)
    signal.alarm(LIMIT_S)
    try:
        found = verify_result(folder)
        found.table(), json.dumps(found.as_dict())
    except InputError:
        return "refused"
    except BaseException as error:
        return f"unclear error: {type(error).__name__}: {error}"
    finally:
        signal.alarm(0)
    with np.errstate(all="ignore"):
        return (false_claim(folder, found) or "true") if found.holds else "refused"


def _give_up(number, frame):
    raise TimeoutError(f"no answer after {LIMIT_S} s")


def false_claim(folder, found):
    """Return the first bound that exceeds an energy of the folder's own samples, empty if none does."""
    record = read_json(folder / "alignment.json")
    names = [shape["name"] for shape in record["shapes"]]
    linear = np.array([shape["transform"] for shape in record["shapes"]], dtype=float)[:, :3, :3]
    placed = np.load(folder / "correspondences.npz")["positions"]
    own = np.stack(
        [(p - p.mean(axis=0)) @ np.linalg.inv(m).T for p, m in zip(placed, linear, strict=True)]
    )
    own /= np.linalg.norm(own, axis=(1, 2))[:, None, None]
    frames = linear / np.cbrt(np.abs(np.linalg.det(linear)))[:, None, None]

    def energy(target, source, invariants):
        pair = invariants[target], invariants[source]
        problem = Problem.from_user(
            own[target], own[source], group=record["decided"]["group"], invariants=pair
        )
        rotation = (frames[target].T @ frames[source])[None]
        return float(energies_of(problem, rotation, MatchingCosts(problem).assign(rotation))[0])

    for pair in found.pairs:
        invariants = np.load(folder / ARCHIVES[0])["invariants"]
        known = energy(names.index(pair.target), names.index(pair.source), invariants)
        if not pair.proven <= known * (1 + TOL) + 1e-12:
            return f"false: {pair.proven:.9g} of {pair.target} - {pair.source}, whose energy is at most {known:.9g}"
    if len({frozenset((pair.target, pair.source)) for pair in found.pairs}) < len(found.pairs):
        return "false: a pair counts twice"
    if found.collection is not None:
        with np.load(folder / ARCHIVES[2]) as file:
            members, edges, invariants = file["members"], file["edges"], file["invariants"]
        at = {int(member): invariants[row] for row, member in enumerate(members)}
        known = sum(energy(int(members[a]), int(members[b]), at) for a, b in edges)
        if not found.collection.proven <= known * (1 + TOL) + 1e-12:
            return f"false: {found.collection.proven:.9g} of the collection, whose energy is at most {known:.9g}"
    return ""


@st.composite
def forgeries(draw):
    """Return functions of a folder, each of which changes one thing in it and may fail at what others left."""
    how = st.sampled_from([_arrays, _moved, _text, _file])
    return draw(st.lists(how.flatmap(lambda change: change()), min_size=1, max_size=3))


def forge(folder, changes):
    """Change a folder; changes of files that others removed or broke do nothing."""
    for change in changes:
        with np.errstate(all="ignore"), suppress(*NOT_FOR_THIS_TYPE, *BROKEN):
            change(folder)


def regular(file):
    """Return a file that an earlier change has left as a file."""
    if not file.is_file() or file.is_symlink():
        raise OSError(file)
    return file


@st.composite
def _arrays(draw):
    """Change an array of an archive, as those of a certificate are changed."""
    name, data = draw(st.sampled_from(ALL_ARCHIVES)), draw(st.data())

    def change(folder):
        with np.load(regular(folder / name)) as archive:
            arrays = dict(archive)
        np.savez(folder / name, **data.draw(changed(arrays)))

    return change


@st.composite
def _moved(draw):
    """Scale, shift, turn, mirror or permute the samples of one shape or all, in one archive or in all."""
    rng, kind = (
        draw(generators),
        draw(st.sampled_from(["linear", "shift", "turn", "mirror", "swap"])),
    )
    some = draw(st.sampled_from([slice(None), *(slice(at, at + 1) for at in range(3))]))
    names = draw(st.sampled_from([ARCHIVES, *((name,) for name in ARCHIVES)]))
    linear = np.exp(rng.normal()) * np.eye(3)
    linear = {"turn": Rotation.random(rng=rng).as_matrix(), "mirror": -np.eye(3)}.get(kind, linear)
    shift = rng.normal(size=3) if kind == "shift" else np.zeros(3)

    def change(folder):
        for name in names:
            with np.load(regular(folder / name)) as archive:
                arrays = dict(archive)
            points = arrays["positions" if "positions" in arrays else "coordinates"]
            if kind == "swap":
                points[some] = points[some][:, rng.permutation(points.shape[1])]
            else:
                points[some, :, :3] = points[some, :, :3] @ linear.T + shift
            np.savez(folder / name, **arrays)

    return change


@st.composite
def _text(draw):
    """Repeat, remove or exchange lines of a table or record, or replace one of its numbers."""
    name, at, other = draw(
        st.tuples(st.sampled_from(TABLES), st.floats(0, 0.999), st.floats(0, 0.999))
    )
    kind = draw(st.sampled_from(["twice", "gone", "number", "number", "number", "exchanged"]))
    new = draw(st.sampled_from([*HUGE, 0.5, -1.0, 1.5, 100.0]))

    def change(folder):
        lines = regular(folder / name).read_text().splitlines(keepends=True)
        row, line = int(at * len(lines)), lines[int(at * len(lines))]
        if kind == "number":
            numbers = [*re.finditer(r"(?<![a-z0-9.])\d[\d.e+-]*", line)]
            number = numbers[int(other * len(numbers))]
            text = new if isinstance(new, str) else str(float(number[0]) * new)
            lines[row] = line[: number.start()] + text + line[number.end() :]
        else:
            exchanged = [lines[int(other * len(lines))]]
            lines[row : row + 1] = {"twice": [line] * 2, "gone": [], "exchanged": exchanged}[kind]
        (folder / name).write_text("".join(lines))

    return change


@st.composite
def _file(draw):
    """Put another file, or no regular one, in the place of one, or add one that nobody names."""
    names = st.sampled_from([*ALL_ARCHIVES, *TABLES])
    name, other = draw(names), draw(names)
    kinds = ["other", "cut", "empty", "gone", "fifo", "folder", "device", "loop", "unnamed"]
    kind, share = draw(st.sampled_from(kinds)), draw(st.floats(0, 1))

    def change(folder):
        file, data = folder / name, regular(folder / other).read_bytes()
        if kind == "unnamed":
            (folder / "certificates" / "2-0.npz").write_bytes(data)
            return
        file.unlink()
        makers = {
            "other": lambda: file.write_bytes(data),
            "cut": lambda: file.write_bytes(data[: int(share * len(data))]),
            "empty": lambda: file.write_bytes(b""),
            "gone": lambda: None,
            "fifo": lambda: os.mkfifo(file),
            "folder": file.mkdir,
            "device": lambda: file.symlink_to("/dev/zero"),
            "loop": lambda: file.symlink_to(file),
        }
        makers[kind]()

    return change
