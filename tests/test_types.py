"""What a type checker tells a user: misspelt keywords and values of wrong kinds, and nothing of right calls."""

import os
import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pytest

import collalign
import pairwise
from collalign.align import CollectionKeywords
from collalign.engine.run_options import RunKeywords
from collalign.landmarks.templates import SemilandmarkKeywords
from collalign.nonrigid.map_options import NonrigidKeywords
from collalign.options import AlignKeywords, TwoShapeKeywords
from collalign.products.own import Own, OwnKeywords
from collalign.synchronization.problem.graph import GraphArguments
from data_tools.errors import OptionsError
from data_tools.options import CleaningKeywords, EmbeddingKeywords, SamplingKeywords
from pairwise.matching import MatchKeywords
from pairwise.options import PairKeywords
from pairwise.problem.problem import ProblemArguments

ROOT = Path(__file__).resolve().parents[1]
START = """
import numpy as np
import collalign
import pairwise
points = np.zeros((8, 3))
"""
RIGHT = """
aligned = collalign.align_collection("bones", seed=1, jobs=2, group="O", sampling={"num_points": 32}, progress=False)
aligned = collalign.align_collection("bones", candidates={("a", "b"): np.eye(3)}, options={"seed": 1})
sampling = collalign.SamplingOptions(num_points=32)
rigid = collalign.match_rigid(points, points, group="O", sampling=sampling, matching={"num_draws": 8})
overlap = collalign.match_in_part("a.ply", "b.ply", sampling={"normalisation": "none"})
bent = collalign.match_shapes("a.ply", "b.ply", orientation="any")
found = pairwise.match(points, points, group="O", weights=np.ones(8), certify=True, num_draws=8)
bound = pairwise.solve_relaxation(points, points, group="O").lower_bound
frames = collalign.synchronize([(0, 1)], [np.eye(3)], energies=[0.1])
marks = collalign.transfer_landmarks("result", ["A.fcsv"], surface_points=100, curves=["RIM/A.fcsv"])
error: type[Exception] = collalign.InputError
result: collalign.MatchResult = found
"""
#: One misuse a line.
WRONG = """
collalign.align_collection("bones", sede=1)
collalign.align_collection("bones", num_points=32)
collalign.align_collection("bones", group="both")
collalign.align_collection("bones", sampling={"num_pionts": 32})
collalign.align_collection("bones", seed="one")
collalign.match_rigid("a.ply", "b.ply", scaling="rigid")
collalign.match_shapes("a.ply", "b.ply", orientation="mirrored")
pairwise.match(points, points, gruop="O")
collalign.synchronize([(0, 1)], [np.eye(3)], energy=[0.1])
collalign.transfer_landmarks("result", ["A.fcsv"], curve_pionts=9)
collalign.AlignOptions(sed=1)
collalign.load("result").rotation
"""


def wrong_lines(folder, text):
    """Return the lines of a file that mypy reports."""
    (folder / "use.py").write_text(text)
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file", str(ROOT / "pyproject.toml"), "use.py"]
    command += ["--cache-dir", str(ROOT / ".mypy_cache")]
    environment = {**os.environ, "MYPYPATH": str(ROOT)}
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=folder, env=environment, timeout=600
    )
    assert done.returncode in (0, 1), done.stdout + done.stderr
    numbers = {int(found[1]) for found in re.finditer(r"^use\.py:(\d+): error", done.stdout, re.MULTILINE)}
    return [text.splitlines()[number - 1] for number in sorted(numbers)]


def test_misuses_are_type_errors_and_right_calls_are_not(tmp_path):
    assert wrong_lines(tmp_path, START + RIGHT + WRONG) == WRONG.strip().splitlines()


KEYWORDS = (
    *((CleaningKeywords, collalign.CleaningOptions), (SamplingKeywords, collalign.SamplingOptions)),
    *((EmbeddingKeywords, collalign.EmbeddingOptions), (PairKeywords, collalign.PairOptions)),
    *((AlignKeywords, collalign.AlignOptions), (TwoShapeKeywords, collalign.TwoShapeOptions)),
    *((RunKeywords, collalign.RunOptions), (NonrigidKeywords, collalign.NonrigidOptions), (OwnKeywords, Own)),
    (SemilandmarkKeywords, collalign.SemilandmarkRequest),
)


@pytest.mark.parametrize(("keywords", "options"), KEYWORDS, ids=lambda kind: kind.__name__)
def test_keywords_are_the_fields_and_each_is_documented(keywords, options):
    names = [one.name for one in fields(options)]
    assert [*get_type_hints(keywords)] == names
    for name in names:
        assert re.search(rf"^    {name} : ", options.__doc__, re.MULTILINE), name


def test_keywords_that_are_passed_on_are_those_of_what_takes_them():
    problem = {*ProblemArguments.__annotations__}
    assert {*get_type_hints(MatchKeywords)} == problem | {one.name for one in fields(pairwise.MatchOptions)}
    assert {*get_type_hints(CollectionKeywords)} == {
        one.name for kind in (collalign.AlignOptions, collalign.RunOptions, Own) for one in fields(kind)
    }
    for arguments, function in ((ProblemArguments, pairwise.Problem), (GraphArguments, collalign.PairGraph)):
        taken = function.from_user.__kwdefaults__
        assert {*arguments.__annotations__} == {*taken}


@pytest.mark.parametrize(
    ("call", "keywords", "advice"),
    [
        ("align", {"num_points": 3}, "it belongs to sampling: use sampling={'num_points': ...}"),
        ("align", {"num_pionts": 3}, "did you mean sampling={'num_points': ...}?"),
        ("align", {"agd_weight": 1.0}, "use embedding={'agd_weight': ...}"),
        ("align", {"sed": 3}, "did you mean 'seed'?"),
        ("rigid", {"num_points": 3}, "use sampling={'num_points': ...}"),
        ("rigid", {"scaling": "rigid"}, "matched up to scale"),
        ("part", {"scaling": "rigid"}, "sampling={'normalisation': 'none'}"),
    ],
)
def test_a_keyword_of_another_level_is_told_where_it_belongs(call, keywords, advice):
    points = np.random.default_rng(0).random((8, 3))
    function = {"align": collalign.align_collection, "rigid": collalign.match_rigid, "part": collalign.match_in_part}
    given = ([points, points],) if call == "align" else (points, points)
    with pytest.raises(OptionsError, match=re.escape(advice)):
        function[call](*given, **keywords)
