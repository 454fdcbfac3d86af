import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from data_tools.errors import InputError
from pairwise.certificates import verify_pm_sdp
from pairwise.certificates.certificate import CertificateArrays
from pairwise.certificates.verify import VERIFIERS
from tests.fuzz import targets
from tests.fuzz.forgeries import folder_endings, honest_result
from tests.fuzz.forgeries import judge as judge_folder
from tests.fuzz.harness import GOOD, Report, damaged, fuzz, how_it_ended
from tests.fuzz.hostile import certificate_endings, honest, judge
from tests.fuzz.hostile_files import cases
from tests.fuzz.mutations import CHANGES, MARK
from tests.job_functions import end_as_told

ROOT = Path(__file__).parent.parent
#: How many files of each kind are damaged here.
NUMBERS = {
    "shapes": 90,
    "landmarks": 40,
    "stores": 30,
    "records": 60,
    "certificate-files": 30,
    "configs": 10,
}


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    return targets.kinds(tmp_path_factory.mktemp("kinds"))


def test_the_undamaged_files_are_good(kinds):
    assert all(files for _, files in kinds.values())
    for target, files in (kinds[kind] for kind in NUMBERS if kind != "configs"):
        assert all(target(item) >= 0 for item in files.items())
    with pytest.raises(InputError, match="holds no shape file"):  # and not that an option is wrong
        targets.read_config(("a.toml", kinds["configs"][1]["a.toml"]))


def test_damaged_files_end_in_a_clear_error_or_a_value(kinds):
    endings = [*fuzz(kinds, NUMBERS, seed=7)]
    assert Report.of(endings).bad == {}
    for kind in NUMBERS:
        found = {ending for name, ending in endings if name.startswith(f"{kind} ")}
        assert found == ({"clear errors"} if kind == "configs" else {"valid", "clear errors"})


ON_LINUX = pytest.mark.skipif(sys.platform != "linux", reason="limits on memory need Linux")


@ON_LINUX
def test_hostile_files_are_read_or_refused():
    words = [sys.executable, "-m", "tests.fuzz", "hostile=24"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    num = int(re.match(r"hostile: (\d+) cases: .*\d+ refused", done.stdout)[1])
    assert num >= 24
    assert len(cases()) >= 120


#: Targets that are not confined enough, and how each is to end.
BAD_ENDINGS = {
    "lambda _: (_ for _ in ()).throw(KeyError('a'))": "unclear error: ",
    "lambda _: bytes(3 * 2**30)": "unclear error: ",
    "lambda _: re.match(r'(a|a)*b', 'a' * 60)": "undecided: no answer",
    "lambda _: os.kill(os.getpid(), 9)": "undecided: killed by signal 9",
    "lambda _: refuse('not read: IndexError')": "names internals: ",
    "lambda _: refuse('is damaged')": "refused",
    "len": "valid",
}


@ON_LINUX
def test_hostile_files_that_end_badly_are_noticed():
    script = f"""
import os, re
from data_tools.errors import InputError
from tests.fuzz import confined

def refuse(reason):
    raise InputError(reason)

confined.TIME_S = 1
for target in ({", ".join(BAD_ENDINGS)}):
    print(repr(confined.confined(target, ("a.ply", b""))))
"""
    words = [sys.executable, "-c", script]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    found = done.stdout.splitlines()
    for ending, wanted in zip(found, BAD_ENDINGS.values(), strict=True):
        assert ending[1:].startswith(wanted)
        assert (ending[1:-1] in GOOD or ending[1:-1] == "valid") == (wanted in ("refused", "valid"))


@pytest.mark.parametrize("message", [f"not a number: {MARK}", "UnboundLocalError"])
def test_reasons_that_quote_the_file_or_name_internals_are_noticed(monkeypatch, message):
    def refuse(path):
        raise InputError(message)

    monkeypatch.setattr(targets, "read_shape", refuse)
    with pytest.raises(RuntimeError, match="quotes the file"):
        targets.read_and_sample(("a.ply", MARK.encode()))


def test_forged_certificates_prove_nothing_false():
    report = Report.of(certificate_endings(150, seed=7))
    assert report.bad == {}
    assert min(report.counts["true"], report.counts["refused"]) > 12
    assert {certificate.kind for _, certificate in honest()} == VERIFIERS.keys()
    assert {judge(problem, certificate, True) for problem, certificate in honest()} == {"true"}


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    return honest_result(tmp_path_factory.mktemp("project")).parent


def finds(endings, kind):
    """Whether any of the endings is of a kind; no more are tried than that takes."""
    return any(ending.startswith(kind) for _, ending in endings)


def test_forged_folders_prove_nothing_false(project, monkeypatch):
    assert judge_folder(project / "out") == "true"
    report = Report.of(folder_endings(project / "out", 40, seed=7))
    assert report.bad == {}
    assert min(report.counts["true"], report.counts["refused"]) > 2
    monkeypatch.setattr("collalign.output.verify._check_samples", lambda *_: None)
    monkeypatch.setattr("collalign.output.verify._Result.exceeds", lambda *_: False)
    assert finds(folder_endings(project / "out", 60, seed=7), "false")


def test_the_attack_finds_verifiers_that_trust_types_or_eigenvalues(monkeypatch):
    def as_given(self, name, shape):
        values = np.array(self._take(name, shape, "f"))
        return (
            values
            if self._exponent is None
            else np.ldexp(values, -self._exponent).astype(values.dtype)
        )

    with monkeypatch.context() as patch:
        patch.setattr(CertificateArrays, "floats", as_given)
        assert finds(certificate_endings(600), "unclear error")
    monkeypatch.setattr(verify_pm_sdp, "_eigenvalue_floor", lambda matrix: 1e-3)
    assert finds(certificate_endings(600), "false")


def test_damage_is_damage_and_repeats_with_its_seed(kinds):
    files = kinds["shapes"][1]
    one = [damaged(files, 0, i) for i in range(50)]
    assert one == [damaged(files, 0, i) for i in range(50)]
    assert one != [damaged(files, 1, i) for i in range(50)]
    assert sum(data == files[name] for name, data in one) < 10
    assert len(CHANGES) == 10


def test_the_harness_notices_every_bad_ending(monkeypatch, tmp_path):
    monkeypatch.setattr(
        "tests.fuzz.harness.damaged", lambda files, seed, i: ("a.x", b"riv"[i : i + 1])
    )
    report = Report.of(
        fuzz({"files": (end_as_told, {"a.x": b""})}, {"files": 3}, keep=tmp_path / "bad")
    )
    assert report.counts == {"valid": 1, "clear errors": 1, "unclear errors": 1}
    assert len(report.bad) == len(list((tmp_path / "bad").iterdir())) == 1
    assert "3 cases" in str(report)
    for reason, kind in (
        ("ran past the time limit of 1 s", "hangs"),
        ("ended its worker", "crashes"),
    ):
        assert how_it_ended(SimpleNamespace(crashed=True, failure=reason)) == f"{kind}: {reason}"
