"""``collalign open``: who may ask, what is read and written, and that its buttons do what the command line does."""

import json
import re
import shutil
import signal
import stat
import sys
import time
from contextlib import ExitStack, contextmanager, suppress
from http.client import HTTPConnection
from io import BytesIO
from pathlib import Path
from socket import create_connection
from subprocess import PIPE, Popen
from threading import Barrier, Thread, active_count
from types import SimpleNamespace

import pytest
from scipy.spatial.transform import Rotation

import collalign
from collalign.cli.open_command import served
from collalign.cli.open_workspace import Workspace
from data_tools.datasets.synthetic import write_collection
from data_tools.errors import InputError, OptionsError
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.io.temporary import TemporaryFolder, remove_left
from data_tools.options import AS_STORED, SamplingOptions
from data_tools.surface.shape import Shape
from tests.browser import Page
from tests.faults import is_running
from tests.finished_runs import chairs, finished_run

#: Tries to read and change what is around it, and says what it managed.
HOSTILE = """<body><script>
const managed = [], tries = [() => parent.document.title = "x", () => localStorage.length, () => top.location = "/"];
tries.forEach((one, at) => { try { one(); managed.push(at); } catch {} });
parent.postMessage({ name: "decisions.json", text: "{" }, "*");
const done = () => { document.body.dataset.tried = managed; };
fetch("../state").then(() => managed.push("fetch"), () => {}).finally(done);
</script>"""


#: Of a run that takes little time.
FEW = collalign.AlignOptions(
    seed=3,
    refine=False,
    incomplete="never",
    maps="never",
    sampling=SamplingOptions(num_points=16, num_dense_points=0),
)


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return finished_run(tmp_path_factory.mktemp("served"), chairs(4), FEW, report=True)


@contextmanager
def answering(place):
    """A server of a workspace that answers until it is left: one that goes on slows all tests after it."""
    with TemporaryFolder() as private, served(Workspace(place), private) as server:
        thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


class Client:
    """Somebody who asks a server, with the cookie that it got."""

    def __init__(self, server):
        self.host, self.base = f"127.0.0.1:{server.server_port}", server.doors.base
        self.cookie = ""

    def ask(self, path, body=None, **headers):
        """Return status and text of an answer; a path without a slash is one of the page."""
        connection = HTTPConnection(self.host, timeout=60)
        headers = {"Origin": f"http://{self.host}", "Cookie": self.cookie} | headers
        path = path if path.startswith("/") else f"{self.base}{path}"
        with suppress(BrokenPipeError):  # the answer may be there before all is sent
            connection.request("POST" if body else "GET", path, body, headers)
        with connection.getresponse() as answer:
            self.given = answer.getheader("Set-Cookie", "")
            self.cookie = self.given.partition(";")[0] or self.cookie
            return answer.status, answer.read().decode()

    def enter(self, address):
        """Open one of the printed addresses."""
        return self.ask(f"/{address.split('/', 3)[3]}")


@pytest.fixture(scope="module")
def server(out):
    with answering(out) as server:
        yield server


@pytest.fixture(scope="module")
def ask(server):
    client = Client(server)
    assert client.enter(server.doors.printed())[0] == 200
    return client.ask


def test_only_who_was_let_in_and_asks_from_the_page_is_answered(ask, server):
    assert ask("state")[0] == 200
    stranger = Client(server)
    stranger.cookie = f"{server.doors.cookie}={server.doors.base}"
    for path in ("/", "/state", "state", "", "stop", "result/report.html", "enter/x", "nothing"):
        status, text = stranger.ask(path)
        assert status == 403
        assert "printed last in the terminal" in text
    assert stranger.ask("stop", "{}")[0] == stranger.ask("run/align", "{}")[0] == 403
    others = ("null", "http://evil.example", f"http://127.0.0.1:{server.server_port - 1}")
    assert {ask("run/align", "{}", Origin=other)[0] for other in others} == {403}
    assert ask("state", Host="evil.example:80")[0] == 403


def test_an_address_lets_in_once_and_the_next_is_printed(server):
    mine, other = Client(server), Client(server)
    address = server.doors.printed()
    assert mine.enter(address)[0] == 200
    for word in ("HttpOnly", "SameSite=Strict", f"Path={server.doors.base}"):
        assert word.lower() in mine.given.lower()
    assert address.rpartition("/")[2] not in mine.given
    assert mine.ask("state")[0] == 200
    status, text = other.enter(address)
    assert (status, other.cookie) == (403, "")
    assert "This address has been used" in text
    assert other.ask("state")[0] == 403
    assert mine.enter(address)[0] == 200, "whoever is in stays in"
    following = server.doors.printed()
    assert mine.enter(following)[0] == 200
    assert other.enter(following)[0] == 200, "whoever is in uses no address up"


def test_of_many_who_use_an_address_at_once_one_is_let_in(server):
    address, barrier, answers = server.doors.printed(), Barrier(8), []

    def enter():
        barrier.wait()
        answers.append(Client(server).enter(address)[0])

    threads = [Thread(target=enter) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(answers) == [200] + [403] * 7


def test_the_page_that_a_browser_is_given_is_its_users_alone_and_leads_in_once(server):
    file = server.doors.file
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert stat.S_IMODE(file.parent.stat().st_mode) == 0o700
    (address,) = {*re.findall(r"http://[^\s\"]+", file.read_text())}
    assert Client(server).enter(address)[0] == 200
    assert Client(server).enter(address)[0] == 403


def test_connections_that_say_nothing_take_few_threads_and_keep_nobody_out(server, ask):
    before = active_count()
    with ExitStack() as stack:
        for _ in range(100):
            stack.enter_context(create_connection(("127.0.0.1", server.server_port)))
        assert ask("state")[0] == 200
        assert active_count() - before <= 33
    assert ask("state")[0] == 200


def test_a_connection_that_says_nothing_for_long_is_closed(out, monkeypatch, capfd):
    monkeypatch.setattr("collalign.cli.open_command._Quiet.timeout", 0.05)
    with answering(out) as server:
        for begin in (b"", b"GET / HTTP/1.0\r\n", b"POST / HTTP/1.0\r\nContent-Length: 5\r\n\r\n"):
            with create_connection(("127.0.0.1", server.server_port), timeout=60) as silent:
                silent.sendall(begin)
                while silent.recv(1000):
                    pass
    assert capfd.readouterr().err == ""


def test_uploads_are_taken_in_pieces_and_up_to_a_limit(server, ask, monkeypatch):
    before = b"name,kind\n" + b"chair1,a\n" * 10
    assert ask("files/labels.csv", before)[0] == 200
    too_long = {"Content-Length": str(600 * 2**20)}
    status, text = ask("files/labels.csv", "x", **too_long)
    assert (status, "at most" in text) == (400, True)
    assert ask("run/align", "{}", **{"Content-Length": str(2**21)})[0] == 400
    assert "how long" in ask("files/labels.csv", iter([b"name,kind\n"]))[1]
    client = Client(server)
    assert client.ask("files/labels.csv", "x", **too_long)[0] == 403
    sizes = []
    with monkeypatch.context() as patch:
        patch.setattr("collalign.cli.open_command.TemporaryFile", lambda dir: Recording(sizes))
        assert ask("files/labels.csv", before * 2**14)[0] == 200
    assert max(sizes) <= 2**16
    assert sum(sizes) == len(before) * 2**14


class Recording(BytesIO):
    """A file that notes how much is written at a time."""

    def __init__(self, sizes):
        super().__init__()
        self.sizes = sizes

    def write(self, piece):
        self.sizes.append(len(piece))
        return super().write(piece)


def test_only_pages_are_served_and_hostile_files_and_names_are_refused(ask, out):
    before = {path for path in (out / "given").rglob("*") if path.is_file()}
    results = json.loads(ask("state")[1])["results"]
    assert ask(f"{results}report.html")[0] == 200
    assert {
        ask(f"{results}{path}")[0] for path in ("../a", "%2e%2e/a", "store.sqlite", "/etc/passwd")
    } == {404}
    assert {
        ask(f"files/{name}", "1,2,3")[0] for name in ("..%2Fa", "%2E%2E", "decisions.json")
    } <= {400, 404}
    for task, names in [
        ("align", {"exclude": ["--store=x"]}),
        ("export", {"format": "../x"}),
        ("certify", {}),
    ]:
        assert ask(f"run/{task}", json.dumps(names))[0] == 400
    assert {path for path in (out / "given").rglob("*") if path.is_file()} == before


def test_simultaneous_requests_start_one_command(out, monkeypatch):
    started, workspace, barrier, said = [], Workspace(out), Barrier(12), []

    def popen(command, **how):
        started.append(command)
        time.sleep(0.05)
        return SimpleNamespace(poll=lambda: None, stdout=[])

    def start():
        barrier.wait()
        try:
            workspace.start("variation", {})
        except InputError as error:
            said.append(str(error))

    monkeypatch.setattr("collalign.cli.open_workspace.Popen", popen)
    threads = [Thread(target=start) for _ in range(12)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(started) == 1
    assert len(said) == 11
    assert {*said} == {"a command is running; wait for its end, or stop it"}


@pytest.mark.parametrize("path", ["run/align", "files/decisions.json"])
def test_what_is_nested_too_deeply_is_a_bad_request(ask, path):
    assert ask(path, "[" * 200_000)[0] == 400


def test_files_of_the_user_are_not_overwritten(out, tmp_path):
    copy = tmp_path / "out"
    shutil.copytree(out, copy)
    (copy / "given" / "templates").mkdir(parents=True, exist_ok=True)
    (copy / "given" / "labels.csv").write_text("name,kind\nmine,a\n")
    (copy / "given" / "templates" / "chair1.csv").write_text("mine")
    workspace = Workspace(copy)
    with pytest.raises(InputError, match=r"labels\.csv: .*was not written by this program"):
        workspace.put("labels.csv", BytesIO(b"name,kind\nchair1,b\n"))
    with pytest.raises(InputError, match=r"chair1\.csv: .*was not written by this program"):
        workspace.put("chair1.csv", BytesIO(b"0,0,0\n1,1,1\n"))
    assert (copy / "given" / "labels.csv").read_text() == "name,kind\nmine,a\n"
    assert (copy / "given" / "templates" / "chair1.csv").read_text() == "mine"
    workspace.put("chair2.csv", BytesIO(b"0,0,0\n1,1,1\n"))
    workspace.put("chair2.csv", BytesIO(b"0,0,0\n1,1,2\n"))
    assert (copy / "given" / "templates" / "chair2.csv").read_bytes() == b"0,0,0\n1,1,2\n"


def test_a_table_is_one_of_labels_whatever_it_is_called(out, tmp_path):
    shutil.copytree(out, copy := tmp_path / "out")
    workspace = Workspace(copy)
    table = b"specimen,sex,age\nchair1,f,3\nchair2,m,4\n"
    assert workspace.put("specimens.csv", BytesIO(table)) == {"kept": "labels"}
    assert (copy / "given" / "labels.csv").read_bytes() == table
    assert workspace.put("chair2.csv", BytesIO(b"0,0,0\n1,1,1\n")) == {"kept": "landmarks"}
    with pytest.raises(InputError, match=r"^others\.csv: ") as refused:
        workspace.put("others.csv", BytesIO(b"specimen,sex,age\ngull,f,3\n"))
    assert "staging" not in str(refused.value)
    assert (copy / "given" / "labels.csv").read_bytes() == table


def test_running_again_takes_decisions_leaves_out_and_keeps_the_options(ask, out):
    result = collalign.load(out)
    frame = {one: R.tolist() for one, R in zip(result.names, result.rotations, strict=True)}
    R = Rotation.from_euler("x", 40, degrees=True).as_matrix() @ frame.pop(result.names[0])
    decisions = [{"shape": result.names[0], "decision": "pose", "rotation": R.tolist()}]
    record = {
        "format": "collalign-corrections",
        "version": 1,
        "decisions": decisions,
        "frame": frame,
    }
    assert ask("files/decisions.json", json.dumps(record))[0] == 200
    words = Workspace(out).words("align", {"exclude": [result.names[3]]})
    asked = (f"--corrections={out / 'given' / 'decisions.json'}", f"--exclude={result.names[3]}")
    assert {"--seed=3", "--refine=False", *asked} <= {*words}


def test_a_command_runs_in_a_process_of_its_own_until_its_exit_code(ask, out):
    assert ask("run/export", json.dumps({"format": "csv"}))[0] == 200
    while (progress := json.loads(ask("progress")[1]))["code"] is None:
        time.sleep(0.1)
    assert (progress["code"], progress["command"].split()[:2]) == (0, ["collalign", "export"])
    assert [*out.glob("export-csv/*.csv")]


@contextmanager
def shown(browser, place):
    """The page of a workspace in a browser, and its frame of a task."""
    with (
        answering(place) as server,
        Page(browser, server.doors.file, offline=False) as opened,
    ):
        yield opened, lambda task: opened.page.frame_locator(f"[data-shows={task}]")


def press(page, button, words):
    page.get_by_role("button", name=button).click()
    page.locator("#command code", has_text=words).wait_for(state="attached")
    page.locator("#said", has_text="Done").wait_for()


def test_a_folder_is_worked_on_in_the_browser_from_alignment_to_landmarks(browser, tmp_path):
    folder, out, hostile = tmp_path / "shapes", tmp_path / "shapes-aligned", "<b>'$(x)"
    write_collection(folder, chairs(3))
    (folder / "chair3.ply").rename(folder / f"{hostile}.ply")
    (tmp_path / "specimens.csv").write_text("name,kind\nchair1,a\nchair2,b\n")
    points = read_shape(folder / "chair1.ply", AS_STORED).vertices[::40]
    rows = "".join(f"{name},{x},{y},{z}\n" for name, (x, y, z) in enumerate(points))
    (tmp_path / "chair1.csv").write_text(f"label,x,y,z\n{rows}")
    with shown(browser, folder) as (opened, frame):
        page = opened.page
        page.locator("#found", has_text="3 shapes (3 ply).").wait_for()
        assert hostile in page.locator("#shapes").text_content()
        page.get_by_label("Left and right").select_option("SO")
        press(page, "Align this folder", "--group=SO")
        card = frame("align").locator(".card", has_text="chair2")
        ticked = page.locator("#shapes li", has_text="chair2").get_by_label("leave out")
        for out_of_it in (True, False):
            card.get_by_label("leave out").set_checked(out_of_it)
            page.wait_for_function(
                "([box, on]) => box.checked === on", arg=[ticked.element_handle(), out_of_it]
            )
        assert frame("align").locator(".decisions").is_hidden()
        frame("align").locator(".tile").nth(1).click()
        frame("align").get_by_label("Compare with").select_option(index=1)
        frame("align").get_by_role("button", name="This pose is right").click()
        assert "at the top of the window" in frame("align").locator(".decisions").inner_text()
        press(page, "Apply 1 decision and run again", "--corrections")
        assert '"confirmed"' in (out / "given" / "decisions.json").read_text()
        press(page, "Export", "export")
        page.locator("#files").set_input_files(
            [tmp_path / "specimens.csv", tmp_path / "chair1.csv"]
        )
        page.locator("#said", has_text="specimens.csv (labels), chair1.csv (landmarks)").wait_for()
        press(page, "Transfer landmarks", "given/templates/chair1.csv")
        assert hostile in page.locator("#shapes").text_content()
        assert page.locator("#shapes b").count() == 0
    assert list(out.glob("export-*/*"))


def test_files_that_have_moved_are_asked_for_and_found(browser, tmp_path):
    out = finished_run(tmp_path, chairs(3), FEW, report=True)
    now = (tmp_path / "shapes").rename(tmp_path / "now")
    with shown(browser, out) as (opened, frame):
        page = opened.page
        page.locator("#lost", has_text="3 of 3 files are not where they were").wait_for()
        assert page.locator("#again").is_disabled()
        frame("align").locator(".tile").first.wait_for()
        (nothing := tmp_path / "nothing").mkdir()
        page.locator("#where").fill(str(nothing))
        page.get_by_role("button", name="They are here").click()
        page.locator("#said", has_text="holds none of the files").wait_for()
        assert ["400" in problem for problem in opened.problems] == [
            True
        ]  # which the browser's console notes
        opened.problems.clear()
        page.locator("#where").fill(str(now))
        page.get_by_role("button", name="They are here").click()
        page.locator("#said", has_text="All files are found").wait_for()
        assert page.locator("#moved").is_hidden()
        assert page.locator("#again").is_enabled()
    workspace = Workspace(out)
    assert workspace.words("align", {})[1] == str(now)
    assert f"--sources={now}" in workspace.words("export", {"format": "ply"})
    assert Workspace(out, sources=now).state()["missing"] == []


def test_a_run_is_stopped_and_gone_on_with(browser, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))  # of the commands, not of this process
    (tmp_path / "tmp").mkdir()
    write_collection(tmp_path / "shapes", chairs(5))
    with shown(browser, tmp_path / "shapes") as (opened, _):
        page = opened.page
        page.get_by_role("button", name="Align this folder").click()
        while not (tmp_path / "shapes-aligned" / "store.sqlite").exists():
            page.wait_for_timeout(20)
        page.get_by_role("button", name="Stop").click()
        page.locator("#said", has_text="Stopped with exit code 143").wait_for()
        assert [*(tmp_path / "tmp").iterdir()] == []
        assert not (tmp_path / "shapes-aligned" / "alignment.json").exists()
        press(page, "Align this folder", "align")


def test_a_hostile_report_sees_and_does_nothing(browser, out, tmp_path):
    shutil.copytree(out, tmp_path / "out")
    (tmp_path / "out" / "report.html").write_text(HOSTILE)
    with shown(browser, tmp_path / "out") as (opened, frame):
        frame("align").locator("body[data-tried='']").wait_for(state="attached")
        assert opened.page.get_by_role("button", name="Run again").is_enabled()
        assert opened.page.title() == "collalign"
        opened.problems.clear()  # what the browser says of each refusal


def test_links_between_the_pages_of_a_large_result_work(browser, out, tmp_path):
    """Their frame is a sandbox, from which no cookie is sent."""
    shutil.copytree(out, tmp_path / "out")
    (tmp_path / "out" / "report_pages").mkdir()
    link = '<a href="report_pages/page-001.html">more</a>'
    (tmp_path / "out" / "report.html").write_text(link)
    back = '<a href="../report.html">back</a>'
    (tmp_path / "out" / "report_pages" / "page-001.html").write_text(back)
    with shown(browser, tmp_path / "out") as (_, frame):
        for words in ("more", "back"):
            frame("align").get_by_role("link", name=words).click()
        frame("align").get_by_role("link", name="more").wait_for()


def test_a_browser_that_was_not_let_in_is_told_how_to_come_in(browser, out):
    with answering(out) as server, browser.new_context() as stranger:
        address = server.doors.printed()
        assert Client(server).enter(address)[0] == 200
        page = stranger.new_page()
        page.goto(address)
        assert "This address has been used" in page.locator("body").inner_text()
        page.get_by_role("link", name="go on here").click()
        page.get_by_role("heading", name="You have not been let in").wait_for()
        page.goto(server.doors.printed())
        page.wait_for_selector("html[data-ready]", state="attached")
        assert page.url.endswith(server.doors.base)
        page.goto(address)
        page.get_by_role("button", name="Run again").wait_for()


#: Stands for a browser that the command waits for, such as lynx: says what it was given, and follows the page.
BROWSER = """
import re, sys, urllib.request
given, said = sys.argv[1:]
file = given.removeprefix("file://")
(address,) = {*re.findall('http://[^ "]+', open(file).read())}
answer = urllib.request.urlopen(address)
page = urllib.request.Request(answer.url.split("enter")[0])
page.add_header("Cookie", answer.headers["Set-Cookie"].split(";")[0])
text = urllib.request.urlopen(page).read().decode()
key = address.rsplit("/", 1)[1]
run = urllib.request.Request(page.full_url + "run/align", b"{}", dict(page.header_items()))
urllib.request.urlopen(run)
open(said, "w").write(f"{given} {key} {'Run again' in text}")
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_browser_that_is_waited_for_is_answered_and_the_end_ends_what_was_begun(
    number, tmp_path, monkeypatch
):
    write_collection(tmp_path / "shapes", chairs(8))
    (tmp_path / "browser.py").write_text(BROWSER)
    (tmp_path / "tmp").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    browser = f"{sys.executable} {tmp_path / 'browser.py'} %s {tmp_path / 'said'}"
    monkeypatch.setenv("BROWSER", browser)
    command = [sys.executable, "-m", "collalign", "open", str(tmp_path / "shapes")]
    with Popen(command, stdout=PIPE, stderr=PIPE, text=True) as process, ExitStack() as stack:
        stack.callback(process.kill)  # whatever fails
        address, once = process.stdout.readline(), process.stdout.readline()
        assert "works once" in once
        while not (tmp_path / "said").exists() or not (tmp_path / "said").read_text():
            assert process.poll() is None
            time.sleep(0.02)
        given, key, has_page = (tmp_path / "said").read_text().split()
        assert has_page == "True"
        assert given.startswith("file://")
        while not (commands := below(process.pid)):  # a thread that ends hands its commands on
            assert process.poll() is None
            time.sleep(0.02)
        (begun,) = commands
        for pid in (process.pid, begun):
            words = Path(f"/proc/{pid}/cmdline").read_text()
            assert key not in words
            assert address.strip().rpartition("/")[2] not in words
        while not (tmp_path / "shapes-aligned" / "store.sqlite").exists():
            assert is_running(begun)
            time.sleep(0.02)
        process.send_signal(number)
        errors = process.stderr.read()
    assert process.returncode == (128 + number if number != signal.SIGKILL else -number)
    assert "Traceback" not in errors
    deadline = time.monotonic() + 300.0
    while is_running(begun) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not is_running(begun)
    assert not (tmp_path / "shapes-aligned" / "alignment.json").exists()
    if number == signal.SIGKILL:
        remove_left(str(tmp_path / "tmp"))  # as the next run does
    assert [*(tmp_path / "tmp").iterdir()] == []


def below(parent):
    """Return the commands that a process has started and that run."""
    pids = set()
    for file in Path(f"/proc/{parent}/task").glob("*/children"):
        with suppress(FileNotFoundError, ProcessLookupError):  # the thread has ended
            pids |= {int(pid) for pid in file.read_text().split()}
    return {pid for pid in pids if b"\0align\0" in Path(f"/proc/{pid}/cmdline").read_bytes()}


def test_specimens_of_parts_are_opened(tmp_path):
    for at, shape in enumerate(chairs(3).shapes):
        for name, way in (("low", 0.0), ("high", 3.0)):
            part = Shape(name=name, vertices=shape.vertices + way, faces=shape.faces)
            (tmp_path / "shapes" / f"c{at}").mkdir(parents=True, exist_ok=True)
            write_mesh(tmp_path / "shapes" / f"c{at}" / f"{name}.ply", part)
    aligned = collalign.align_collection(
        tmp_path / "shapes", options=FEW, parts=True, jobs=1, progress=False
    )
    aligned.save(tmp_path / "out", report=False)
    workspace = Workspace(tmp_path / "out")
    assert [shape["name"] for shape in workspace.state()["shapes"]] == ["c0", "c1", "c2"]
    assert workspace.words("align", {})[1:3] == [str(tmp_path / "shapes"), "--parts"]


def test_a_folder_is_described_before_anything_is_aligned(tmp_path):
    write_collection(tmp_path / "shapes", chairs(3))
    (tmp_path / "shapes" / "notes.md").write_text("mine")
    workspace = Workspace(tmp_path / "shapes")
    state = workspace.state()
    assert not state["aligned"]
    assert state["found"].startswith("3 shapes (3 ply). ")
    assert [shape["name"] for shape in state["shapes"]] == ["chair1", "chair2", "chair3"]
    asked = {
        "exclude": ["chair1"],
        "incomplete": ["chair1", "chair2"],
        "group": "O",
        "scaling": "similarity",
    }
    assert {*workspace.words("align", asked)[3:]} == {
        "--group=O",
        "--incomplete=chair2",
        "--exclude=chair1",
    }
    with pytest.raises(InputError, match="exclude"):
        workspace.words("align", {"exclude": ["--store=x"]})
    with pytest.raises(OptionsError):
        workspace.words("align", {"group": "x"})


def test_a_killed_server_leaves_whole_files_and_can_be_opened_again(out, tmp_path):
    copy, whole = tmp_path / "out", "name,kind\n" + "chair1,b\n" * 20_000
    shutil.copytree(out, copy)
    script = (
        "import sys; from io import BytesIO; from pathlib import Path\n"
        "from collalign.cli.open_workspace import Workspace\n"
        "workspace = Workspace(Path(sys.argv[1])); text = 'name,kind\\n' + 'chair1,{}\\n' * 20_000\n"
        "workspace.put('labels.csv', BytesIO(text.replace('{}', 'a').encode())); print('ready', flush=True)\n"
        "while True:\n"
        "    for kind in 'ba': workspace.put('labels.csv', BytesIO(text.replace('{}', kind).encode()))\n"
    )
    with Popen([sys.executable, "-c", script, str(copy)], stdout=PIPE) as process:
        assert process.stdout.readline() == b"ready\n"
        time.sleep(0.05)
        process.kill()
    assert (copy / "given" / "labels.csv").read_text() in (whole, whole.replace(",b\n", ",a\n"))
    Workspace(copy).put("labels.csv", BytesIO(whole.encode()))
    assert (copy / "given" / "labels.csv").read_text() == whole
    kept = {path.name for path in (copy / "given" / ".collalign").iterdir()}
    assert {name for name in kept if not name.startswith(".")} <= {"manifest.json", "lock"}, (
        "temporary files may stay"
    )
