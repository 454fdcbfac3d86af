import dataclasses

import joblib
import pytest

from collalign.engine.run_options import RunOptions
from collalign.options import AlignOptions
from data_tools.errors import OptionsError
from data_tools.options import CleaningOptions, EmbeddingOptions, SamplingOptions


@pytest.mark.parametrize("kind", [CleaningOptions, SamplingOptions, EmbeddingOptions])
def test_defaults_are_valid_frozen_and_keyword_only(kind: type) -> None:
    options = kind()
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(options, dataclasses.fields(kind)[0].name, None)
    with pytest.raises(TypeError):
        kind(True)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("num_points", 3), ("num_points", 20.0), ("num_points", True), ("num_dense_points", -1), ("max_faces", 10),
        ("metric", "taxicab"), ("normalisation", "volume"),
    ],
)  # fmt: skip
def test_impossible_sampling_is_refused_by_name(field: str, value: object) -> None:
    with pytest.raises(OptionsError, match=field):
        SamplingOptions(**{field: value})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("field", "value"),
    [("kind", "xyz+normals"), ("num_eigenfunctions", 0), ("hks_weight", float("nan")), ("hks_weight", "a"),
     ("agd_weight", float("inf")), ("agd_weight", -0.1), ("agd_weight", None)],
)  # fmt: skip
def test_impossible_embeddings_are_refused_by_name(field: str, value: object) -> None:
    with pytest.raises(OptionsError, match=field):
        EmbeddingOptions(**{field: value})  # type: ignore[arg-type]


def test_kinds_say_what_they_need() -> None:
    needs = {kind: EmbeddingOptions(kind=kind) for kind in ("xyz", "xyz+lb", "xyz+invariants", "all")}  # type: ignore[arg-type]
    assert [o.has_eigenfunctions for o in needs.values()] == [False, True, False, True]
    assert [o.has_invariants for o in needs.values()] == [False, False, True, True]


def test_there_are_as_many_workers_as_asked_for_but_no_more_than_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(joblib, "cpu_count", lambda: 4)
    assert [RunOptions(jobs=jobs).num_workers for jobs in (-1, 1, 3, 16)] == [4, 1, 3, 4]


def test_there_are_no_more_options_than_anybody_reads() -> None:
    flat = [value if isinstance(value, dict) else [value] for value in dataclasses.asdict(AlignOptions()).values()]
    assert sum(map(len, flat)) <= 35
