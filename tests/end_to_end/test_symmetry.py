"""Asymmetry that was planted in generated bilateral shapes is found from their files, as a user does it."""

import numpy as np
import pytest

import collalign
from data_tools.datasets.synthetic import planted_collection
from data_tools.datasets.synthetic_shapes import sphere_mesh
from data_tools.errors import InputError
from data_tools.landmark_files import Landmarks
from data_tools.options import SamplingOptions
from data_tools.surface.shape import Shape
from tests.commands import read_rows, run_command
from tests.finished_runs import finished_run, on_files

#: Height of the one-sided bump of each specimen, in radii.
PLANTED = (0.0, 0.0, 0.1, 0.2, 0.3, 0.0)
#: Pairs of places, left then right, by direction.
SIDES = np.array([[0.8, 0.5, 0.3], [0.6, -0.6, 0.5], [0.7, 0.1, -0.7]])


def bump(points, place, height):
    unit = place / np.linalg.norm(place)
    return height * np.exp(-((points - unit) ** 2).sum(axis=1) / 0.18)[:, None] * unit


def specimens():
    """Return ellipsoids with paired horns and a snout, which differ symmetrically, and in one bump on one side."""
    rng = np.random.default_rng(3)
    sphere, faces = sphere_mesh(900)
    shapes = []
    for at, planted in enumerate(PLANTED):
        vertices = sphere * [1.0, 1.5, 0.8] * rng.uniform(0.95, 1.05, 3)
        for place, height in zip(SIDES, rng.uniform(0.2, 0.4, 3), strict=True):
            for sign in (-1, 1):
                vertices = vertices + bump(sphere, place * [sign, 1, 1], height)
        vertices = vertices + bump(sphere, np.array([0.0, 1.0, 0.4]), 0.5)
        vertices = vertices + bump(sphere, np.array([0.9, -0.1, 0.2]), planted)
        shapes.append(Shape.from_arrays(vertices, faces, name=f"s{at}"))
    return shapes


PLANTED_COLLECTION = planted_collection(
    specimens(), np.random.default_rng(4), scale_range=(0.5, 2.0)
)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    options = collalign.AlignOptions(sampling=SamplingOptions(num_points=24))
    return finished_run(tmp_path_factory.mktemp("symmetry"), PLANTED_COLLECTION, options)


def check_planted(folder, names):
    """The asymmetry of each specimen follows its bump."""
    found = {
        row["name"]: float(row["asymmetry"])
        for row in read_rows(folder / "symmetry/asymmetric.csv")
    }
    planted = np.array([PLANTED[int(name[1:])] for name in names])
    asymmetry = np.array([found[name] for name in names])
    assert np.corrcoef(asymmetry, planted)[0, 1] > 0.95
    assert asymmetry[planted == 0].max() < 0.5 * asymmetry[planted == 0.2].min()


def test_the_planted_asymmetry_is_found(result, tmp_path):
    names = collalign.load(result).names
    labels = tmp_path / "labels.csv"
    labels.write_text("name,owner\n" + "".join(f"{name},{name}\n" for name in names))
    to = tmp_path / "variation"
    words = [
        "variation",
        str(result),
        "--to",
        str(to),
        "--symmetry",
        "auto",
        "--jobs",
        "1",
        "--labels",
        str(labels),
    ]
    run_command(*words, "--individuals", "owner")
    check_planted(to, names)
    anova = {row["effect"]: row for row in read_rows(to / "symmetry/procrustes_anova.csv")}
    assert list(anova) == ["individual", "side", "individual:side", "total"]
    assert np.isclose(sum(float(row["Rsq"]) for row in anova.values()), 2)
    sizes = [float(row["centroid_size_surface"]) for row in read_rows(to / "scores.csv")]
    assert max(sizes) > 1.5 * min(sizes)
    assert len(list((to / "symmetry/specimens").iterdir())) == len(names)
    run_command(*words, "--individuals", "nobody", ends=InputError.exit_code)


def test_landmark_pairs_say_where_the_mirror_plane_is(result, tmp_path):
    """The right pairs lead to the planted asymmetry like the search; pairs that are no mirror image are refused."""
    marks = landmarks("s0")
    table = tmp_path / "pairs.csv"
    table.write_text(
        "left,right\n" + "".join(f"left {at},right {at}\n" for at in range(len(SIDES)))
    )
    run = collalign.RunOptions(jobs=1, store=result / "store.sqlite")
    collalign.statistics.write_surface_variation(
        result, tmp_path / "given", landmarks=marks, symmetry=table, run=run
    )
    check_planted(tmp_path / "given", collalign.load(result).names)
    wrong = [("left 0", "right 1"), ("left 1", "left 2"), ("right 0", "right 2")]
    with pytest.raises(InputError, match="mirror image"):
        collalign.statistics.write_surface_variation(
            result, tmp_path / "no", landmarks=marks, symmetry=wrong, run=run
        )
    with pytest.raises(InputError, match="name files"):
        collalign.statistics.write_surface_variation(
            result, tmp_path / "no", symmetry=table, run=run
        )
    assert not (tmp_path / "no").exists()


def landmarks(name):
    """Return the horns of a specimen as landmarks in its file's coordinates."""
    sphere = sphere_mesh(900)[0]
    sides = np.concatenate([SIDES * [-1, 1, 1], SIDES])
    chosen = [
        int(np.linalg.norm(sphere - place / np.linalg.norm(place), axis=1).argmin())
        for place in sides
    ]
    labels = tuple(f"{side} {number}" for side in ("left", "right") for number in range(len(SIDES)))
    points = on_files(PLANTED_COLLECTION, chosen)[int(name[1:])]
    return {name: Landmarks(labels=labels, points=points)}
