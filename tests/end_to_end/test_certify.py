"""The certification of a collection, as a user runs it, on generated shapes."""

import html
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

import collalign
from collalign.engine.store import Store
from collalign.options import AlignOptions
from collalign.output.loading import load
from collalign.output.verify import verify_result
from collalign.tools.certify.command import certification_notes
from collalign.wording import note_records
from data_tools.errors import InputError, OptionsError
from data_tools.options import SamplingOptions
from tests.commands import run_command
from tests.finished_runs import chairs, finished_run
from tests.notes import codes
from tests.view_problems import write_result

OPTIONS = AlignOptions(sampling=SamplingOptions(num_points=16, num_dense_points=200))


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """A finished result of four chairs, with its store."""
    return finished_run(tmp_path_factory.mktemp("certify"), chairs(4), OPTIONS, report=True)


def test_the_command_proves_most_of_the_energy_and_goes_on_from_the_store(result):
    said = run_command("certify", result, "--jobs", "1").out.splitlines()
    first = (result / "certification.json").read_bytes()
    record = json.loads(first)
    kinds = ["bound", "cheapest", "fixed", "scope"]
    assert codes(record["statement"]) == [f"arrangement-{kind}" for kind in kinds]
    notes = load(result).notes
    assert note_records(notes[-4:]) == record["statement"]
    assert [note["text"] for note in record["statement"]] == said[:4]
    assert html.escape(said[0]) in (result / "report.html").read_text("utf-8")
    assert 0.9 < record["share"] <= 1.0
    assert record["lower_bound"] <= record["energy"]["cheapest_known"]
    assert (
        record["energy"]["cheapest_known"] <= record["energy"]["near"] <= record["energy"]["stated"]
    )
    with Store.open(result / "store.sqlite") as store:
        num_proofs = len(store.keys("proofs"))
    assert num_proofs == 6 * len(record["bound_of_each_round"])
    run_command("certify", result, "--jobs", "1")
    assert (result / "certification.json").read_bytes() == first
    assert load(result).notes == notes
    with Store.open(result / "store.sqlite") as store:
        assert len(store.keys("proofs")) == num_proofs


def test_a_part_is_named_and_a_shape_that_stands_on_its_head_is_found(result, tmp_path):
    view, run = load(result), collalign.RunOptions(jobs=1, store=result / "store.sqlite")
    part = collalign.certify_collection(result, shapes=view.names[1:3], run=run, progress=False)
    assert part.names == view.names[1:3]
    assert part.joint.edges.tolist() == [[0, 1]]
    assert part.joint.share > 0.99
    transforms = view.transforms.copy()
    transforms[2, :3, :3] = np.diag([-1.0, -1.0, 1.0]) @ transforms[2, :3, :3]
    write_result(replace(view, transforms=transforms), tmp_path)
    found = collalign.certify_collection(tmp_path, run=run, progress=False)
    assert found.changes_deg[2] > 90.0
    vague = replace(found, joint=replace(found.joint, bound=0.4 * found.joint.energy))
    assert certification_notes(vague)[2].code == "arrangement-free"
    assert np.delete(found.changes_deg, 2).max() < 20.0
    assert found.joint.near_energy > found.joint.energy
    refuted = certification_notes(found)[1]
    assert (refuted.code, refuted.shapes) == ("arrangement-refuted", view.names[2:3])
    assert (refuted.values["doubtful"] == ()) == (view.confidence[2] >= 0.95)
    sure, unsure = (
        certification_notes(replace(found, confidence=np.full(4, one)))[1] for one in (1.0, 0.5)
    )
    assert sure.values["doubtful"] == ()
    assert unsure.values["doubtful"] == view.names[2:3]


def test_wrong_names_files_and_options_are_refused(result, tmp_path):
    with pytest.raises(InputError, match="no shape is called 'nobody'"):
        collalign.certify_collection(result, shapes=["nobody"])
    with pytest.raises(InputError, match="holds no pair of these shapes"):
        collalign.certify_collection(result, shapes=load(result).names[:1])
    with pytest.raises(OptionsError, match="budget_s"):
        collalign.certify_collection(result, budget_s=0.0)
    copy = tmp_path / "out"
    shutil.copytree(result, copy)
    (copy / "certification.json").unlink(missing_ok=True)
    (copy / ".collalign" / "manifest.json").unlink(missing_ok=True)
    (copy / "certification.json").write_text("mine")
    run_command("certify", copy, "--jobs", "1", ends=2)
    assert (copy / "certification.json").read_text() == "mine"


@pytest.fixture
def proof(result, tmp_path):
    """The result with a fresh certification, to be damaged."""
    run_command("certify", result, "--jobs", "1")
    shutil.copytree(result, tmp_path / "out")
    return tmp_path / "out"


def rewritten(folder, **changes):
    """What is said of the proof once some of its arrays are others."""
    with np.load(folder / "certification.npz") as archive:
        arrays = {name: archive[name] for name in archive.files}
    np.savez_compressed(folder / "certification.npz", **{**arrays, **changes})
    try:
        found = verify_result(folder).collection
    finally:
        np.savez_compressed(folder / "certification.npz", **arrays)
    assert found is not None
    return found


def test_verify_proves_the_bound_again_from_the_file_alone(proof, capsys):
    record = json.loads((proof / "certification.json").read_bytes())
    capsys.readouterr()
    run_command("certify", proof, "--verify", "--budget-s", "1", ends=2)
    assert "takes no other option" in capsys.readouterr().err
    run_command("certify", proof, "--verify")
    assert "Collection: no arrangement of the 4 shapes costs less than" in capsys.readouterr().out
    found = rewritten(proof)
    assert found.proven >= record["lower_bound"] * (1 - 1e-9)
    assert str(replace(found, proven=0.0)).endswith(f"known costs {found.energy:.6g}.")
    assert found.energy == pytest.approx(record["energy"]["cheapest_known"])
    assert found.proven <= found.energy
    (proof / "certification.npz").write_bytes(b"no archive")
    run_command("certify", proof, "--verify", ends=2)


def test_a_forged_proof_is_refused_or_proves_no_more(proof):
    with np.load(proof / "certification.npz") as archive:
        arrays = {name: archive[name] for name in archive.files}
    true = rewritten(proof)
    for changes, words in (
        ({"bound": np.array(1.01 * true.energy)}, "claims the bound"),
        ({"bound": np.array(np.nan)}, "bound"),
        ({"depths": arrays["depths"][:-1]}, "num_cells"),
        ({"depths": arrays["depths"][::-1]}, "tile"),
        ({"tilts": 1e60 * np.ones_like(arrays["tilts"])}, "too large"),
        ({"tilts": 0.0 * arrays["tilts"]}, "claims the bound"),
        ({"tilts": arrays["tilts"][::-1]}, "claims the bound"),
        ({"tilts": np.full_like(arrays["tilts"], np.nan)}, "tilts"),
        ({"diagonal": arrays["diagonal"] + np.eye(3)}, "claims the bound"),
        ({"num_cells": arrays["num_cells"][::-1]}, "tile"),
        ({"num_cells": 0 * arrays["num_cells"]}, "num_cells"),
        ({"depths": arrays["depths"] + 1}, "tile"),
        ({"edges": np.repeat(arrays["edges"][:1], 6, axis=0)}, "twice"),
        ({"edges": arrays["edges"][:, ::-1]}, "no pair"),
        ({"frames": -arrays["frames"]}, "reflected"),
        ({"frames": 2.0 * arrays["frames"]}, "frames"),
        ({"diagonal": arrays["diagonal"][:, 0]}, "diagonal"),
    ):
        assert words in rewritten(proof, **changes).fault
    for name in ("coordinates", "members"):
        with pytest.raises(InputError, match=r"certification\.npz|members"):
            rewritten(proof, **{name: arrays[name][::-1] * (1 if name == "members" else 3)})
    (proof / ".collalign" / "manifest.json").unlink()
    with pytest.raises(InputError, match="holds no certificates"):
        verify_result(proof)
