import dataclasses

import joblib
import numpy as np
import pytest

import collalign
from collalign.engine.run_options import RunOptions
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.options import AlignOptions, TwoShapeOptions
from collalign.tools.stability.run import StabilityOptions
from data_tools.errors import CollalignError, OptionsError
from data_tools.options import CleaningOptions, EmbeddingOptions, SamplingOptions
from pairwise.options import MatchOptions, PairOptions
from pairwise.rotation_sets import random_rotations

OPTIONS = (
    *(
        AlignOptions,
        TwoShapeOptions,
        PairOptions,
        RunOptions,
        CleaningOptions,
        SamplingOptions,
        EmbeddingOptions,
    ),
    *(MatchOptions, SurfaceOptions, NonrigidOptions, StabilityOptions),
)
#: What no field takes, whatever its type, but those of names and paths, which are looked up later.
NOTHING = object()
NAMES = ("reference", "scheduler", "store")
#: Minus any number of jobs leaves as many cores free, and any candidate may be kept.
ALLOWED = (("jobs", -(10**9)), ("candidate_factor", float("inf")), ("time_limit_s", float("inf")))


@pytest.mark.parametrize("kind", OPTIONS, ids=lambda kind: kind.__name__)
def test_options_are_frozen_keyword_only_and_check_every_field(kind):
    options = kind()
    with pytest.raises(TypeError):
        kind(True)
    for field in dataclasses.fields(kind):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(options, field.name, None)
        value = getattr(options, field.name)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        for wrong in (
            NOTHING,
            *((-(10**9), float("nan"), float("inf"), str(value)) if is_number else ()),
        ):
            if (field.name, wrong) in ALLOWED or field.name in NAMES or isinstance(value, tuple):
                continue
            with pytest.raises(CollalignError, match=field.name):
                kind(**{field.name: wrong})


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        (SamplingOptions, "num_points", 3),
        (SamplingOptions, "num_points", 20.0),
        (SamplingOptions, "num_points", True),
        (SamplingOptions, "max_faces", 10),
        (EmbeddingOptions, "kind", "xyz+normals"),
        (EmbeddingOptions, "num_eigenfunctions", 0),
        (EmbeddingOptions, "agd_weight", -0.1),
        (StabilityOptions, "num_points", (2,)),
        (StabilityOptions, "num_seeds", -1),
    ],
)
def test_impossible_values_are_refused_by_name(kind, field, value):
    with pytest.raises(OptionsError, match=field):
        kind(**{field: value})


def test_there_are_as_many_workers_as_asked_for_but_no_more_than_cores(monkeypatch):
    monkeypatch.setattr(joblib, "cpu_count", lambda: 4)
    assert [RunOptions(jobs=jobs).num_workers for jobs in (-1, 1, 3, 16)] == [4, 1, 3, 4]


def test_the_preset_of_the_paper_sets_what_the_paper_did():
    paper = AlignOptions(preset="paper")
    assert (paper.group, paper.pairs, paper.synchronization) == ("SO", "all", "spectral")
    assert (paper.maps, paper.incomplete, paper.refine) == ("never", "never", False)
    assert (paper.sampling.num_points, paper.sampling.num_dense_points) == (20, 0)
    assert paper.embedding == EmbeddingOptions(kind="xyz+lb")
    assert paper.matching == PairOptions(strategy="relaxation", row_sums=False, num_draws=0)
    own = AlignOptions(
        preset="paper", group="O", sampling={"num_points": 30}, matching={"max_candidates": 3}
    )
    assert (own.group, own.sampling.num_points, own.sampling.num_dense_points) == ("O", 30, 0)
    assert own.matching == dataclasses.replace(paper.matching, max_candidates=3)
    assert dataclasses.replace(paper, seed=1) == AlignOptions(preset="paper", seed=1)
    assert AlignOptions(preset="default") == AlignOptions()


def test_the_preset_of_the_paper_relaxes_every_pair_and_the_default_none(rng):
    points, turns = rng.random((20, 3)), np.stack([np.eye(3), *random_rotations(3, 2, rng)])
    clouds = {
        f"s{i}": (points + 0.01 * rng.standard_normal((20, 3))) @ turn
        for i, turn in enumerate(turns)
    }
    paper, default = (
        collalign.align_collection(
            clouds, preset=preset, embedding={"kind": "xyz"}, jobs=1, progress=False
        )
        for preset in ("paper", "default")
    )
    assert np.isfinite([pair.lower_bound for pair in paper.pairs]).tolist() == [True] * 3
    assert np.isnan([pair.lower_bound for pair in default.pairs]).tolist() == [True] * 3
    np.testing.assert_allclose(paper.rotations, turns, atol=0.1)
    assert np.isnan(paper.confidence).all()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"sampling": "many"},
            "sampling: expected a table of options or SamplingOptions, got 'many'",
        ),
        ({"sampling": {"num_pionts": 3}}, "did you mean 'num_points'"),
        ({"options": "fast"}, "options: expected a table of options or AlignOptions"),
        ({"sed": 1}, "no option 'sed'; did you mean 'seed'"),
        ({"run": {"job": 1}}, "run: there is no option 'job'; did you mean 'jobs'"),
    ],
)
def test_what_is_no_option_is_refused_before_any_work(given, message):
    with pytest.raises(OptionsError, match=message):
        collalign.align_collection("no such folder", **given)
