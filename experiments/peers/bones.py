"""The toolkit compared with its peers on the same generated bones: ``python -m experiments.peers.bones``.

Prints a table of Markdown, one row per tool and collection as soon as it is measured. Every tool runs in a process of
its own with one thread or worker, from the files to the rotations, with what it has to import.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
import os
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.datasets.synthetic import PlantedCollection, planted_collection, write_collection
from data_tools.datasets.synthetic_shapes import smooth_field, sphere_mesh
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape

SEED = 5
#: Vertices of each bone, and bones.
SIZES = (5_000, 20_000, 100_000, 500_000)
NUMBERS = (10, 50, 100)
TOOLS = ("collalign", "open3d", "axes")
#: Joints of a bone: direction, width, height.
_JOINTS = (
    ((0.55, 0.1, 0.83), 0.08, 0.5),
    ((-0.5, 0.2, 0.85), 0.06, 0.4),
    ((0.45, -0.25, -0.86), 0.07, 0.42),
    ((-0.45, -0.2, -0.87), 0.06, 0.36),
)


def bone(directions: FloatArray, faces: IntArray, rng: np.random.Generator, name: str) -> Shape:
    """Return a long bone: a bent shaft with a head, a trochanter and two condyles, no two specimens alike.

    Parameters
    ----------
    directions : ndarray, shape (v, 3)
        Vertices of a sphere, which place the bone's vertices.
    faces : ndarray of int, shape (f, 3)
    rng : numpy.random.Generator
    name : str
    """
    x, y, z = directions.T
    thickness = 0.28 + 0.1 * z**2
    points = np.column_stack(
        [x * thickness, 0.9 * y * thickness, 1.5 * (1 + 0.03 * rng.standard_normal()) * z]
    )
    for axis, width, height in _JOINTS:
        squared = ((directions - np.array(axis) / np.linalg.norm(axis)) ** 2).sum(axis=1)
        points += (height * (1 + 0.1 * rng.standard_normal()) * np.exp(-squared / width))[
            :, None
        ] * directions
    points[:, 0] += 0.1 * (1 + 0.2 * rng.standard_normal()) * points[:, 2] ** 2
    points *= 1 + 0.06 * smooth_field(points, rng, num_bumps=12, width=0.35)[:, None]
    return Shape.from_arrays(points, faces, name=name)


def bones(num_vertices: int, num: int) -> PlantedCollection:
    """Return bones in random poses, always the same."""
    rng = np.random.default_rng(SEED)
    directions, faces = sphere_mesh(num_vertices)
    return planted_collection(
        [bone(directions, faces, rng, f"bone{i:03d}") for i in range(num)], rng
    )


def landmarked_bones(num: int, num_vertices: int = 3000) -> tuple[list[Shape], FloatArray]:
    """Return bones that no vertices share, always the same, and their landmarks, shape (num, 16, 3).

    Landmarks are on the joints and evenly spread, and mostly between vertices. The rows 6 to 13 are on the shaft,
    along which the surface does not tell a place: how specimens differ there is how they were made.
    """
    rng = np.random.default_rng(SEED)
    directions, faces = sphere_mesh(num_vertices)
    joints = [np.array(axis) / np.linalg.norm(axis) for axis, _, _ in _JOINTS]
    marked = np.concatenate([joints, sphere_mesh(12)[0]])
    shapes, landmarks = [], []
    for number in range(num):
        turned = directions @ random_rotation(rng).T
        both = np.concatenate([turned, marked])
        made = bone(both, faces, rng, f"bone{number:03d}").vertices
        shapes.append(Shape.from_arrays(made[: len(turned)], faces, name=f"bone{number:03d}"))
        landmarks.append(made[len(turned) :])
    return shapes, np.array(landmarks)


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What one tool needed, and the errors of its relative rotations in degrees, shape (pairs,)."""

    tool: str
    processor_s: float
    memory_gib: float
    errors_deg: FloatArray


def measure(tool: str, folder: Path, truth: FloatArray) -> list[Measured]:
    """Run a tool; in a process of its own, so that its memory and its imports count."""
    from experiments.peers.peer_tools import TOOLS as KNOWN

    answers = KNOWN[tool].align(folder, False, 1)
    memory = peak_gib(os.getpid())
    return [
        Measured(
            tool=name,
            processor_s=answer.elapsed.processor_s,
            memory_gib=memory,
            errors_deg=pair_errors_deg(truth, answer.rotations),
        )
        for name, answer in answers.items()
    ]


def peak_gib(process: int | str) -> float:
    """Return the largest memory of a process so far, and of its living children, added up."""
    folder = Path("/proc") / str(process)
    peak = next(
        line for line in (folder / "status").read_text().splitlines() if line.startswith("VmHWM")
    )
    children = [
        int(word) for path in folder.glob("task/*/children") for word in path.read_text().split()
    ]
    return int(peak.split()[1]) / 2**20 + sum(map(peak_gib, children))


def pair_errors_deg(truth: FloatArray, found: FloatArray) -> FloatArray:
    """Return the errors of all relative rotations, degrees; both are ``R_common_shape``, shape (N, 3, 3)."""
    pairs = itertools.combinations(range(len(truth)), 2)
    return np.array(
        [rotation_angle_deg(truth[a].T @ truth[b], found[a].T @ found[b]) for a, b in pairs]
    )


def compare(sizes: Sequence[int], numbers: Sequence[int], tools: Sequence[str]) -> Iterator[str]:
    """Yield the rows of the table."""
    yield "| vertices | bones | tool | CPU s | GiB | median error | 95 % below | beyond 30 deg |"
    yield "| ---: | ---: | --- | ---: | ---: | ---: | ---: | ---: |"
    for size, num in itertools.product(sizes, numbers):
        with tempfile.TemporaryDirectory() as folder:
            planted = bones(size, num)
            write_collection(Path(folder), planted)
            truth = planted.rotations
            del planted
            for tool in tools:
                fresh = multiprocessing.get_context("spawn")
                with ProcessPoolExecutor(1, mp_context=fresh) as pool:
                    found = pool.submit(measure, tool, Path(folder), truth).result()
                for row in found:
                    gross = int((row.errors_deg > 30).sum())
                    yield (
                        f"| {size} | {num} | {row.tool} | {row.processor_s:.1f} | {row.memory_gib:.2f} "
                        f"| {np.median(row.errors_deg):.2f} | {np.percentile(row.errors_deg, 95):.1f} | {gross} |"
                    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vertices", nargs="*", type=int, default=list(SIZES))
    parser.add_argument("--shapes", nargs="*", type=int, default=list(NUMBERS))
    parser.add_argument("--tools", nargs="*", choices=TOOLS, default=list(TOOLS))
    given = parser.parse_args()
    for line in compare(given.vertices, given.shapes, given.tools):
        print(line, flush=True)


if __name__ == "__main__":
    main()
