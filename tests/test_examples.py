"""Every example in a docstring runs, and what a newcomer calls explains itself on one screen."""

import doctest
import pydoc
from importlib import import_module
from pkgutil import walk_packages
from types import FunctionType

import numpy as np
import pytest

import collalign
import data_tools
import pairwise
from data_tools.datasets.synthetic import bent, demo_collection
from data_tools.datasets.synthetic_shapes import blob, figure
from data_tools.io.shapes import write_mesh
from data_tools.surface.shape import Shape
from tests.test_docs import FACES

pytestmark = pytest.mark.usefixtures("quick_search")

#: Names that examples use without importing them.
KNOWN = {"np": np, "collalign": collalign, "pairwise": pairwise}
#: Lines of a tall terminal window.
SCREEN = 60
FUNCTIONS = {
    f"{module.__name__}.{name}": getattr(module, name)
    for module in (collalign, *FACES, pairwise)
    for name in module.__all__
    if isinstance(getattr(module, name), FunctionType)
}


def examples_of(package):
    """Return the examples of all modules of a package; they may use what their module has imported."""
    names = [package.__name__]
    names += [found.name for found in walk_packages(package.__path__, f"{package.__name__}.")]
    modules = [import_module(name) for name in names if not name.endswith("__main__")]
    finder = doctest.DocTestFinder(exclude_empty=True)
    return [
        test
        for module in modules
        for test in finder.find(module, globs=vars(module) | KNOWN)
        if test.examples
    ]


def complaints(test):
    """Return what is wrong with an example; nothing where it runs as it says."""
    said = []
    doctest.DocTestRunner(verbose=False).run(test, out=said.append)
    return "".join(said)


EXAMPLES = [test for package in (data_tools, pairwise, collalign) for test in examples_of(package)]


#: Numbers of the landmarks of the examples: two of the midline, three of the left, three of the right.
MIDLINE, ONE_SIDE = 2, 3


def write_points(path, points, labels):
    """Write a list of points as 3D Slicer does."""
    path.parent.mkdir(exist_ok=True)
    rows = [
        f"{at},{x},{y},{z},0,0,0,1,1,1,0,{label},,"
        for at, (label, (x, y, z)) in enumerate(zip(labels, points.tolist(), strict=True))
    ]
    path.write_text("\n".join(["# Markups fiducial file version = 4.10", *rows]) + "\n")


def digitised(rng):
    """Return landmarks of six specimens, each digitised twice, (12, 8, 3)."""
    middle, side = rng.normal(size=(MIDLINE, 3)), rng.normal(size=(ONE_SIDE, 3))
    middle[:, 0] = 0.0
    mean = np.concatenate([middle, side, side * [-1.0, 1.0, 1.0]])
    specimens = mean + 0.1 * rng.normal(size=(6, *mean.shape))
    return np.repeat(specimens, 2, axis=0) + 0.01 * rng.normal(size=(12, *mean.shape))


@pytest.fixture(scope="module")
def what_a_user_has(tmp_path_factory):
    """A folder with shapes, a result, landmarks and arrays: the files that examples name."""
    folder, rng = tmp_path_factory.mktemp("examples"), np.random.default_rng(3)
    planted = demo_collection(num=4, resolution=1)
    for name, shape in zip("ABCD", planted.shapes, strict=True):
        place = folder / ("more" if name == "D" else "bones")
        place.mkdir(exist_ok=True)
        write_mesh(place / f"{name}.ply", shape)
    first = planted.shapes[0]
    high, low = (first.vertices[by(first.vertices[:, 2])] for by in (np.argmax, np.argmin))
    write_points(folder / "A.fcsv", np.stack([high, low]), ("top", "foot"))
    write_points(folder / "RIM" / "A.fcsv", first.vertices[:3], "123")
    body = figure(resolution=1)
    write_mesh(folder / "standing.ply", body)
    write_mesh(folder / "bent.ply", bent(body, rng, angle=0.3))
    whole = blob(rng, num_vertices=400)
    kept = (whole.vertices[whole.faces][:, :, 0] < 0.3).all(axis=1)
    write_mesh(folder / "scan.ply", whole)
    write_mesh(folder / "piece.ply", Shape.from_arrays(whole.vertices, whole.faces[kept]))
    np.save(folder / "points.npy", rng.random((40, 3)))
    np.save(folder / "landmarks.npy", digitised(rng))
    jobs = ("[[jobs]]", "folder = 'bones'", "out = 'a'", "[[jobs]]", "folder = 'no'", "out = 'b'")
    (folder / "batch.toml").write_text("\n".join(jobs))
    run = {"jobs": 1, "store": folder / "store.sqlite"}
    collalign.align_collection(folder / "bones", run=run, progress=False).save(folder / "aligned")
    return folder


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
def test_the_example_runs(example, what_a_user_has, monkeypatch):
    monkeypatch.chdir(what_a_user_has)
    assert not complaints(example)


def test_a_wrong_example_is_noticed():
    wrong = doctest.DocTestParser().get_doctest(
        ">>> int(np.sum([1, 1]))\n3\n", dict(KNOWN), "wrong", None, None
    )
    assert "Expected:\n    3\nGot:\n    2" in complaints(wrong)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_public_function_explains_itself(name):
    function = FUNCTIONS[name]
    text = pydoc.plain(pydoc.render_doc(function))
    assert ">>> " in text
    assert len(text.splitlines()) <= SCREEN
    assert max(map(len, text.splitlines()[3:])) <= 120
