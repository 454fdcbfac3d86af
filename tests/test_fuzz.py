import numpy as np
import pytest

from data_tools.errors import InputError
from pairwise.certificates import verify_pm_sdp
from pairwise.certificates.certificate import CertificateArrays
from pairwise.certificates.verify import VERIFIERS
from tests.fuzz import seeds, targets
from tests.fuzz.forgeries import attack_folders, honest_result
from tests.fuzz.forgeries import judge as judge_folder
from tests.fuzz.harness import LIMITS, damaged, fuzz
from tests.fuzz.hostile import attack, honest, judge
from tests.fuzz.mutations import CHANGES, MARK
from tests.fuzz.overlaps import attack_overlaps, run_case
from tests.job_functions import end_as_told

GOOD_ENDINGS = {"valid", "clear errors"}


@pytest.fixture(scope="module")
def shape_files(tmp_path_factory):
    return seeds.shape_files(tmp_path_factory.mktemp("shapes"))


def test_the_undamaged_files_are_good(shape_files, tmp_path):
    for name, data in shape_files.items():
        assert targets.read_and_sample((name, data)) > 20
    assert all(targets.read_landmark_file(file) > 0 for file in seeds.landmark_files().items())
    assert targets.read_store(("a.store", seeds.store_file(tmp_path))) == 2
    assert all(targets.read_record(item) > 0 for item in seeds.records().items())
    assert targets.read_certificate(("a.npz", seeds.certificate_file(tmp_path))) >= 0.0
    with pytest.raises(InputError, match="holds no shape file"):  # and not that an option is wrong
        targets.read_config(("a.toml", seeds.CONFIG.encode()))


def test_damaged_shapes_end_in_a_clear_error_or_a_shape(shape_files):
    report = fuzz(targets.read_and_sample, shape_files, 150, seed=7)
    assert report.bad == {}
    assert report.counts.keys() == GOOD_ENDINGS


@pytest.mark.parametrize("message", [f"not a number: {MARK}", "UnboundLocalError"])
def test_reasons_that_quote_the_file_or_name_internals_are_noticed(monkeypatch, message):
    def refuse(path):
        raise InputError(message)

    monkeypatch.setattr(targets, "read_shape", refuse)
    with pytest.raises(RuntimeError, match="quotes the file"):
        targets.read_and_sample(("a.ply", MARK.encode()))


def test_damaged_stores_records_certificates_and_configurations_end_in_a_clear_error_or_a_value(tmp_path):
    for target, files, num in (
        (targets.read_landmark_file, seeds.landmark_files(), 60),
        (targets.read_store, {"a.store": seeds.store_file(tmp_path)}, 30),
        (targets.read_record, seeds.records(), 100),
        (targets.read_certificate, {"a.npz": seeds.certificate_file(tmp_path)}, 30),
        (targets.read_config, {"a.toml": seeds.CONFIG.encode()}, 10),
    ):
        report = fuzz(target, files, num, seed=7)
        assert report.bad == {}
        assert report.counts.keys() <= GOOD_ENDINGS


def test_forged_certificates_prove_nothing_false():
    report = attack(250, seed=7)
    assert report.bad == {}
    assert min(report.counts["true"], report.counts["refused"]) > 20
    assert {kind for _, certificate in honest() for kind in [certificate.kind]} == VERIFIERS.keys()


def test_the_honest_certificates_are_true():
    assert {judge(problem, certificate, True) for problem, certificate in honest()} == {"true"}


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    return honest_result(tmp_path_factory.mktemp("project")).parent


def test_forged_folders_prove_nothing_false(project, monkeypatch):
    assert judge_folder(project / "out") == "true"
    report = attack_folders(project / "out", 40, seed=7)
    assert report.bad == {}
    assert min(report.counts["true"], report.counts["refused"]) > 2
    monkeypatch.setattr("collalign.output.verify._check_samples", lambda *_: None)
    monkeypatch.setattr("collalign.output.verify._Result.exceeds", lambda *_: False)
    assert any(ending.startswith("false") for ending in attack_folders(project / "out", 60, seed=7).bad.values())


def test_no_overlap_of_output_and_input_loses_or_mixes_in_anything(project, monkeypatch):
    report = attack_overlaps(project, 14, seed=7)
    assert report.bad == {}
    assert min(report.counts["done"], report.counts["refused"]) > 1
    for command, place in (("align", "apart/mine"), ("export csv", "apart/mine"), ("match", "apart/hard")):
        assert run_case(project, command, place) == "refused"
    monkeypatch.setattr("data_tools.io.output_folder.refuse_overlap", lambda *_: None)
    assert run_case(project, "export csv", "meshes/../meshes").startswith("mixed into")


def test_the_attack_finds_verifiers_that_trust_types_or_eigenvalues(monkeypatch):
    def as_given(self, name, shape):
        values = np.array(self._take(name, shape, "f"))
        return values if self._exponent is None else np.ldexp(values, -self._exponent).astype(values.dtype)

    with monkeypatch.context() as patch:
        patch.setattr(CertificateArrays, "floats", as_given)
        endings = {ending.split(":")[0] for ending in attack(600).bad.values()}
        assert "unclear error" in endings
    monkeypatch.setattr(verify_pm_sdp, "_eigenvalue_floor", lambda matrix: 1e-3)
    assert any(ending.startswith("false") for ending in attack(600).bad.values())


def test_damage_is_damage_and_repeats_with_its_seed(shape_files):
    one = [damaged(shape_files, 0, i) for i in range(50)]
    assert one == [damaged(shape_files, 0, i) for i in range(50)]
    assert one != [damaged(shape_files, 1, i) for i in range(50)]
    assert sum(data == shape_files[name] for name, data in one) < 10
    assert len(CHANGES) == 10


def test_the_harness_notices_every_bad_ending(monkeypatch, tmp_path):
    monkeypatch.setattr("tests.fuzz.harness.LIMITS", LIMITS | {"time_limit_s": 1.0})
    monkeypatch.setattr("tests.fuzz.harness.damaged", lambda files, seed, i: ("a.x", b"richv"[i : i + 1]))
    report = fuzz(end_as_told, {"a.x": b""}, 5, keep=tmp_path / "bad")
    assert report.counts == {"valid": 1, "clear errors": 1, "unclear errors": 1, "crashes": 1, "hangs": 1}
    assert len(report.bad) == len(list((tmp_path / "bad").iterdir())) == 3
    assert "5 files" in str(report)
