"""Whatever becomes of the standard streams: no traceback, the files as promised, and the documented exit code."""

import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from collalign import AlignOptions
from collalign.console.streams import Streams
from data_tools.options import SamplingOptions
from tests.finished_runs import chairs, finished_run

COLLALIGN = [sys.executable, "-m", "collalign"]
FEW = AlignOptions(maps="never", sampling=SamplingOptions(num_points=16, num_dense_points=0))
#: What a shell does before and after a command, and the exit code of one that prints and goes well.
WAYS = {
    "out closed": ("", ">&-", 0),
    "out full": ("", ">/dev/full", 1),
    "out unread": ("", "", 141),
    "err closed": ("", "2>&-", 0),
    "err full": ("", "2>/dev/full", 0),
    "err unread": ("", "", 0),
    "all closed": ("", "<&- >&- 2>&-", 0),
    "all full": ("", ">/dev/full 2>&1", 1),
    "few files": ("ulimit -n 20;", "", 0),
}
#: Commands that print only, and their exit codes where nothing disturbs them.
PRINTING = {
    ("--version",): 0,
    ("status", "OUT"): 0,
    ("align", "SHAPES", "--check", "--jobs", "1"): 0,
    ("status", "NOWHERE"): 2,
    ("nonsense",): 2,
}
#: Ways in which they are tried where it is more than one: what prints at once in all, and what opens files where the
#: numbers of closed streams are free for them.
TRIED = {("--version",): (*WAYS,), ("status", "OUT"): ("out full", "all closed", "few files")}
ALIGN = (
    *("align", "SHAPES", "--out", "NEW", "--jobs", "1", "--maps", "never"),
    *("--sampling.num-points", "16", "--sampling.num-dense-points", "0"),
)
EXPORT = ("export", "OUT", "--format", "csv", "--to", "NEW")
#: Commands that write files, one of which comes last.
WRITING = {ALIGN: "alignment.json", EXPORT: "landmarks.csv"}
needs_full = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return finished_run(tmp_path_factory.mktemp("streams"), chairs(4), FEW)


def start(words, before="", after="", *, unread=""):
    """Start a command in a bad way, nobody reading the stream ``unread``, and return how it ended."""
    reader, writer = os.pipe()
    os.close(reader)
    streams = {
        stream: writer if unread[:3] == stream[-3:] else subprocess.PIPE
        for stream in ("stdout", "stderr")
    }
    try:
        command = ["sh", "-c", f'{before} exec "$@" {after}', "sh", *words]
        done = subprocess.run(command, **streams, text=True, check=False, timeout=600)
    finally:
        os.close(writer)
    return SimpleNamespace(code=done.returncode, stdout=done.stdout or "", stderr=done.stderr or "")


def start_in(way, words):
    """Start a command in one of the ways."""
    before, after, _ = WAYS[way]
    return start(words, before, after, unread=way if way.endswith("unread") else "")


def assert_quiet(done):
    """What came through says nothing of Python's insides."""
    for said in (done.stdout, done.stderr):
        assert "Traceback" not in said
        assert "Exception ignored" not in said
        assert "Logging error" not in said


@needs_full
@pytest.mark.parametrize("way", ["out full", "out unread", "out closed"])
def test_the_ways_are_bad_for_a_program_that_does_not_care(way):
    done = start_in(way, [sys.executable, "-c", "print('said'); open(1, 'w', closefd=False)"])
    assert done.code != 0
    with pytest.raises(AssertionError):
        assert_quiet(done)


def placed(words, out, new):
    places = {"OUT": out, "SHAPES": out.parent / "shapes", "NEW": new, "NOWHERE": new / "nowhere"}
    return [*COLLALIGN, *(str(places.get(word, word)) for word in words)]


@needs_full
@pytest.mark.parametrize(
    ("words", "way"),
    [(words, way) for words in PRINTING for way in TRIED.get(words, ("out full",))],
    ids=lambda given: given if isinstance(given, str) else " ".join(given),
)
def test_printing_commands_end_as_documented(words, way, out, tmp_path):
    *_, code = WAYS[way]
    done = start_in(way, placed(words, out, tmp_path))
    assert done.code == (PRINTING[words] or code)
    assert_quiet(done)
    if "out" not in way and "all" not in way and PRINTING[words] == 0:
        assert done.stdout


@needs_full
@pytest.mark.parametrize(
    ("words", "way"),
    [
        *((ALIGN, way) for way in ("all closed", "few files")),
        *((EXPORT, way) for way in ("out full", "out unread", "all full")),
    ],
    ids=lambda given: given if isinstance(given, str) else given[0],
)
def test_writing_commands_write_everything(words, way, out, tmp_path):
    *_, code = WAYS[way]
    done = start_in(way, placed(words, out, tmp_path / "new"))
    assert done.code == code
    assert_quiet(done)
    assert (tmp_path / "new" / WRITING[words]).is_file()
    if way == "out full":
        assert "what was printed is lost" in done.stderr


def test_a_closed_stream_is_not_taken_for_a_file(out, tmp_path):
    """The next file that is opened would get its descriptor, and what libraries print there."""
    code = (
        "import os, sys; from collalign.console.streams import Streams\n"
        "with Streams.guarded(until_exit=True):\n"
        "    file = open(sys.argv[1], 'w'); os.write(1, b'of a library'); os.write(2, b'too')\n"
        "    print('said'); print('said', file=sys.stderr); child = os.system('echo child >&2')\n"
        "sys.exit(child)"
    )
    done = start_in("all closed", [sys.executable, "-c", code, str(tmp_path / "file")])
    assert done.code == 0, "a child inherits the descriptors"
    assert (tmp_path / "file").read_bytes() == b""


def test_a_pipe_that_does_not_wait_is_waited_for():
    code = (
        "import os; os.set_blocking(1, False)\n"
        "from collalign.console.streams import Streams\n"
        "with Streams.guarded(until_exit=True) as streams:\n"
        "    print('x' * 1_000_000); raise SystemExit(streams.code_after(0))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert len(done.stdout) == 1_000_001


def test_a_process_without_streams_runs_commands(monkeypatch):
    monkeypatch.setattr("sys.stdout", None)
    monkeypatch.setattr("sys.stderr", None)
    with Streams.guarded(until_exit=False) as streams:
        print("said")
        print("said", file=sys.stderr)
        assert streams.code_after(0) == 0
    assert sys.stdout is None


@pytest.mark.usefixtures("two_cores")
def test_too_few_files_for_workers_end_in_advice_and_leave_nothing(out, tmp_path):
    """With so many joblib starts workers that cannot open what they share, and print tracebacks."""
    (tmp_path / "tmp").mkdir()
    words = [word if word != "1" else "2" for word in placed(ALIGN, out, tmp_path / "new")]
    done = start(["env", f"TMPDIR={tmp_path / 'tmp'}", *words], "ulimit -n 24;")
    assert done.code == 1
    assert_quiet(done)
    assert "ulimit -n 1024" in done.stderr
    assert [*(tmp_path / "tmp").iterdir()] == []
    assert not (tmp_path / "new" / "alignment.json").exists()


def test_a_log_on_a_full_disk_lacks_lines_and_says_so_once(out, tmp_path):
    words = [*placed(("status", "OUT"), out, tmp_path), "--log", str(tmp_path / "log")]
    assert start(words).code == 0
    with (tmp_path / "log").open("a") as log:
        log.write("#\n" * 2**16)
    done = start(words, "ulimit -f 200;")  # more than SQLite needs to look into a store
    assert done.code == 0
    assert_quiet(done)
    assert done.stderr.count("lines are missing") == 1
    assert done.stdout
