"""Tuned constants are listed as the code has them, and measured on what is named."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest

from data_tools.errors import OptionsError
from experiments.calibration import CALIBRATIONS, Calibration, calibrate, measure_model


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_every_calibration_names_constants_of_its_module(name: str) -> None:
    found = CALIBRATIONS[name]
    module = import_module(found.module)
    assert {constant: getattr(module, constant) for constant in found.constants} == dict(found.constants)


def test_both_values_stand_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    used: list[tuple[str, ...]] = []

    def measure(_: Path, collections: tuple[str, ...]) -> dict[str, float]:
        used.append(collections)
        return {"A": 2.0}

    entry = Calibration(module="somewhere", constants={"A": 1.0}, measure=measure, collections=("all of it",))  # type: ignore[arg-type]
    monkeypatch.setitem(CALIBRATIONS, "mine", entry)
    (row,) = calibrate("mine", Path()).rows
    assert (row["code"], row["measured"]) == (1.0, 2.0)
    calibrate("mine", Path(), ["one"])
    assert used == [("all of it",), ("one",)]
    with pytest.raises(OptionsError, match="mine"):
        calibrate("nobody's", Path())


@pytest.mark.data
def test_the_priors_of_the_likelihood_are_measured(shared_data: Path) -> None:
    found = measure_model(shared_data, ["glasses"], num_shapes=4)
    assert 0 < found["PRIOR_NOISE_RAD"] < 0.35
    assert 0 <= found["PRIOR_OUTLIERS"] < 1
