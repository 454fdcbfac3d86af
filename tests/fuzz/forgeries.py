"""Forged folders of results by the thousand: ``verify`` refuses each, or proves no more of it than is true.

What is true is read from the folder without the verifier: the energy of some arrangement of its samples, which no
lower bound may exceed.
"""

import io
import json
import os
import re
import shutil
import signal
import tempfile
import zipfile
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path

import numpy as np
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
from tests.finished_runs import chairs
from tests.fuzz.hostile import CHANGES, NOT_FOR_THIS_TYPE, drawn

#: What a bound may exceed an energy by, as a share of it, and seconds after which a verifier hangs.
TOL, LIMIT_S = 1e-6, 60
ARCHIVES = ("certificates/problems.npz", "correspondences.npz", "certification.npz")
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


def folder_endings(honest, num, *, seed=0):
    """Forge ``num`` copies of a result and yield what the verifier says; the same seed forges the same."""
    for index in range(num):
        rng = np.random.default_rng((seed, index))
        with tempfile.TemporaryDirectory() as place:
            forged = Path(place) / "out"
            shutil.copytree(honest, forged)
            done = [forge(forged, rng) for _ in range(int(rng.geometric(0.6)))]
            yield f"{seed}-{index} ({', '.join(done)})", judge(forged)


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
    record = json.loads((folder / "alignment.json").read_text())
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


def forge(folder, rng):
    """Change one thing in a folder and return what was done."""
    change = drawn((_arrays, _arrays, _moved, _moved, _text, _file), rng)
    with (
        np.errstate(all="ignore"),
        suppress(*NOT_FOR_THIS_TYPE, OSError, KeyError, EOFError, zipfile.BadZipFile),
    ):
        change(folder, rng)
    return change.__name__.strip("_")


def _regular(folder, names):
    """Those files that an earlier change has left as files."""
    return [
        folder / name
        for name in names
        if (folder / name).is_file() and not (folder / name).is_symlink()
    ]


def _archives(folder):
    return _regular(
        folder,
        [*ARCHIVES, *sorted(f"certificates/{i}-{j}.npz" for i in range(3) for j in range(3))],
    )


def _arrays(folder, rng):
    """Change some arrays of an archive as those of a certificate are changed."""
    file = drawn(_archives(folder), rng)
    with np.load(file) as archive:
        arrays = dict(archive)
    np.savez(file, **drawn(CHANGES, rng)(arrays, rng))


def _moved(folder, rng):
    """Scale, shift, turn or mirror the samples of one shape or all, in one archive or in all that hold them."""
    kind, shape = drawn(("scale", "shift", "turn", "mirror", "swap"), rng), int(rng.integers(4))
    factor, turn, shift = (
        np.exp(rng.normal()),
        Rotation.random(random_state=rng).as_matrix(),
        rng.normal(size=3),
    )
    files = _regular(folder, ARCHIVES)
    for file in files if rng.random() < 0.5 else [drawn(files, rng)]:
        with np.load(file) as archive:
            arrays = dict(archive)
        points = arrays["positions" if "positions" in arrays else "coordinates"]
        some = slice(None) if shape == 3 else slice(shape, shape + 1)
        if kind == "swap":
            points[some] = points[some][:, rng.permutation(points.shape[1])]
        else:
            change = {
                "scale": factor * np.eye(3),
                "turn": turn,
                "mirror": -np.eye(3),
                "shift": np.eye(3),
            }[kind]
            points[some, :, :3] = points[some, :, :3] @ change.T + (
                shift if kind == "shift" else 0.0
            )
        np.savez(file, **arrays)


def _text(folder, rng):
    """Repeat, remove or exchange lines of a table or record, or replace one of its numbers."""
    file = drawn(_regular(folder, TABLES), rng)
    lines = file.read_text().splitlines(keepends=True)
    at, other = (int(k) for k in rng.integers(len(lines), size=2))
    kind = drawn(("twice", "gone", "number", "number", "number", "exchanged"), rng)
    if kind == "number":
        numbers = [
            i for i, c in enumerate(lines[at]) if c.isdigit() and not lines[at][i - 1].isalnum()
        ]
        start = drawn(numbers, rng)
        number = str(re.match(r"[\d.e+-]*", lines[at][start:])[0])
        new = drawn((*HUGE, str(float(number) * drawn((0.5, -1.0, 1.5, 100.0), rng))), rng)
        lines[at] = lines[at][:start] + new + lines[at][start + len(number) :]
    else:
        lines[at : at + 1] = {"twice": [lines[at]] * 2, "gone": [], "exchanged": [lines[other]]}[
            kind
        ]
    file.write_text("".join(lines))


def _file(folder, rng):
    """Put another file, or no regular one, in the place of one, or add one that nobody names."""
    files = [*_archives(folder), *_regular(folder, TABLES)]
    file, other = drawn(files, rng), drawn(files, rng)
    data = other.read_bytes()
    kind = drawn(
        ("other", "cut", "empty", "gone", "fifo", "folder", "device", "loop", "unnamed"), rng
    )
    if kind == "unnamed":
        (folder / "certificates" / f"{rng.integers(3)}-{rng.integers(3)}.npz").write_bytes(data)
        return
    file.unlink()
    makers = {
        "other": lambda: file.write_bytes(data),
        "cut": lambda: file.write_bytes(data[: int(rng.integers(len(data)))]),
        "empty": lambda: file.write_bytes(b""),
        "gone": lambda: None,
        "fifo": lambda: os.mkfifo(file),
        "folder": file.mkdir,
        "device": lambda: file.symlink_to("/dev/zero"),
        "loop": lambda: file.symlink_to(file),
    }
    makers[kind]()
