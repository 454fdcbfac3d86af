"""Forged folders of results prove nothing false, and the attack finds a verifier that would."""

import shutil
import tempfile
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given

from tests.fuzz.damage import fuzzing
from tests.fuzz.forgeries import forge, forgeries, honest_result, judge


@pytest.fixture(scope="module")
def honest(tmp_path_factory):
    return honest_result(tmp_path_factory.mktemp("project"))


def attack(honest, num):
    """Forge folders and return how many ended in each way that is right; raise where one does not."""
    endings = Counter()

    @fuzzing(num)
    @given(forgeries())
    def try_one(changes):
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "out"
            shutil.copytree(honest, folder)
            forge(folder, changes)
            ending = judge(folder)
        assert ending in ("true", "refused")
        endings[ending] += 1

    try_one()
    return endings


def test_forged_folders_prove_nothing_false(honest, monkeypatch):
    assert judge(honest) == "true"
    endings = attack(honest, 40)
    assert min(endings["true"], endings["refused"]) > 2
    monkeypatch.setattr("collalign.output.verify._check_samples", lambda *_: None)
    monkeypatch.setattr("collalign.output.verify._Result.exceeds", lambda *_: False)
    with pytest.raises(AssertionError, match="false: "):
        attack(honest, 600)
