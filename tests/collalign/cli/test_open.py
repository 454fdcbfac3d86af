"""``collalign open``: who may ask, what is read and written, and that its buttons do what the command line does."""

import json
import time
from http.client import HTTPConnection
from threading import Thread
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import collalign
from collalign.cli.desk import Desk
from collalign.cli.open_command import served
from data_tools.datasets.synthetic import write_collection
from tests.browser import Page
from tests.finished_runs import chairs, finished_run


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder, options = tmp_path_factory.mktemp("served"), collalign.AlignOptions(seed=3, refine=False)
    return finished_run(folder, chairs(4), options, report=True)


@pytest.fixture(scope="module")
def ask(out):
    with served(Desk(out)) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        _, _, host, base = server.address.split("/", 3)

        def asked(path, body=None, **headers):
            connection = HTTPConnection(host)
            path, headers = path if path[0] == "/" else f"/{base}{path}", {"Origin": f"http://{host}"} | headers
            connection.request("POST" if body else "GET", path, body, headers)
            return (answer := connection.getresponse()).status, answer.read().decode()

        yield asked


def test_only_who_knows_the_token_and_asks_from_the_page_is_answered(ask):
    assert ask("state")[0] == 200
    assert {ask(path)[0] for path in ("/", "/state", "/wrong/state")} == {403}
    assert {ask("run/align", "{}", Origin=other)[0] for other in ("null", "http://evil.example")} == {403}
    assert ask("state", Host="evil.example:80")[0] == 403


def test_only_pages_are_served_and_hostile_files_and_names_are_refused(ask, out):
    assert ask("result/report.html")[0] == 200
    assert {ask(f"result/{path}")[0] for path in ("../a", "%2e%2e/a", "store.sqlite", "/etc/passwd")} == {404}
    assert {ask(f"files/{name}", "1,2,3")[0] for name in ("..%2Fa", "%2E%2E", "decisions.json")} <= {400, 404}
    for task, names in [("align", {"exclude": ["--store=x"]}), ("export", {"format": "../x"}), ("verify", {})]:
        assert ask(f"run/{task}", json.dumps(names))[0] == 400
    assert not [path for path in (out / "given").rglob("*") if path.is_file()]


def test_running_again_takes_decisions_leaves_out_and_keeps_the_options(ask, out):
    result = collalign.load(out)
    frame = {one: R.tolist() for one, R in zip(result.names, result.rotations, strict=True)}
    R = Rotation.from_euler("x", 40, degrees=True).as_matrix() @ frame.pop(result.names[0])
    decisions = [{"shape": result.names[0], "decision": "pose", "rotation": R.tolist()}]
    record = {"format": "collalign-corrections", "version": 1, "decisions": decisions, "frame": frame}
    assert ask("files/decisions.json", json.dumps(record))[0] == 200
    assert ask("run/align", json.dumps({"exclude": [result.names[3]]}))[0] == 200
    while (progress := json.loads(ask("progress")[1]))["code"] is None:
        time.sleep(0.1)
    assert {"--seed=3", "--refine=False"} <= {*progress["command"].split()}
    again = collalign.load(out)
    assert again.names == result.names[:3]
    np.testing.assert_allclose(again.rotations[1] @ again.rotations[0].T, frame[again.names[1]] @ R.T, atol=1e-9)


def test_a_folder_is_aligned_corrected_run_again_and_exported_in_the_browser(browser, tmp_path):
    write_collection(tmp_path / "shapes", chairs(3))
    with served(Desk(tmp_path / "shapes")) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        with Page(browser, SimpleNamespace(as_uri=lambda: server.address), offline=False) as opened:
            page, shown = opened.page, opened.page.frame_locator("#shown")
            page.get_by_role("button", name="Align this folder").click()
            shown.locator(".tile").nth(1).click()
            shown.get_by_role("button", name="This pose is right").click()
            for button, words in [("Apply 1 decision and run again", "--corrections"), ("Export", "export")]:
                page.get_by_role("button", name=button).click()
                page.locator("#command code", has_text=words).wait_for(state="attached")
                page.locator("#said", has_text="Done").wait_for()
    assert '"confirmed"' in (tmp_path / "shapes-aligned" / "given" / "decisions.json").read_text()
    assert list((tmp_path / "shapes-aligned").glob("export-*/*"))
