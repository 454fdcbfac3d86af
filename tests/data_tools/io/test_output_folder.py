import json
import os
import subprocess
import sys
from itertools import count
from pathlib import Path

import pytest

from data_tools.errors import InputError
from data_tools.io.files import file_stem, file_stems
from data_tools.io.output_folder import (
    BOOKS,
    MANIFEST_FILE,
    OutputFolder,
    output_path,
    refuse_overlap,
)


def write(folder, files, *, writer="test"):
    with OutputFolder.open(folder, writer=writer) as output:
        for name, text in files.items():
            output.stage(*name.split("/")).write_text(text)
        return output.publish(last="summary", complete=True)


def contents(folder):
    files = (p for p in folder.rglob("*") if p.is_file() and BOOKS not in p.parts)
    return {p.relative_to(folder).as_posix(): p.read_text() for p in files}


def test_a_second_run_replaces_what_the_first_wrote_and_nothing_else(tmp_path):
    assert (
        write(tmp_path, {"summary": "1", "meshes/a": "1", "meshes/b": "1"})[0]
        == tmp_path / "summary"
    )
    (tmp_path / "meshes" / "mine.txt").write_text("mine")
    write(tmp_path, {"other": "1"}, writer="another command")
    write(tmp_path, {"summary": "2", "meshes/a": "2"})
    assert contents(tmp_path) == {
        "summary": "2",
        "meshes/a": "2",
        "meshes/mine.txt": "mine",
        "other": "1",
    }
    write(tmp_path, {"summary": "3"})
    assert contents(tmp_path) == {"summary": "3", "meshes/mine.txt": "mine", "other": "1"}


def test_only_the_command_that_wrote_a_file_replaces_it(tmp_path):
    write(tmp_path, {"pairs": "1"}, writer="align")
    with pytest.raises(InputError, match=r"pairs: .*`align`"):
        write(tmp_path, {"pairs": "2", "other": "2"}, writer="export csv")
    assert contents(tmp_path) == {"pairs": "1"}
    write(tmp_path, {"table": "1"}, writer="export tps")
    write(tmp_path, {"table": "2"}, writer="export nts")
    assert contents(tmp_path) == {"pairs": "1", "table": "2"}


@pytest.mark.parametrize("kind", ["file", "changed", "link", "folder"])
def test_a_file_of_somebody_else_is_refused_and_stays(tmp_path, kind):
    out, place = tmp_path / "out", tmp_path / "out" / "report"
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_text("mine")
    write(out, {"summary": "1"} | ({"report": "1"} if kind == "changed" else {}))
    if kind in ("file", "changed"):
        place.write_text("mine")
    elif kind == "link":
        place.symlink_to(elsewhere)
    else:
        (place / "deep").mkdir(parents=True)
    before = contents(out)
    with pytest.raises(InputError, match="Move it away"):
        write(out, {"summary": "2", "report": "2"})
    assert contents(out) == before
    assert elsewhere.read_text() == "mine"
    assert place.is_symlink() == (kind == "link")


@pytest.mark.parametrize("out", ["in", ".", "in/deep", "link", "in/../in"])
def test_inputs_in_the_folder_or_around_it_are_refused_before_anything_is_made(tmp_path, out):
    (tmp_path / "in").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "in")
    with (
        pytest.raises(InputError, match="name a folder apart"),
        OutputFolder.open(tmp_path / out, writer="t", inputs=[tmp_path / "in"]),
    ):
        pytest.fail("was opened")
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["in", "link"]


@pytest.mark.parametrize(
    ("out", "source"),
    [
        ("mount", "in"),
        ("mount/out", "in"),
        ("whole", "in"),
        ("mount", "in/a"),
        ("in", "mount"),
        ("in/out", "mount"),
    ],
)
def test_a_folder_that_is_mounted_elsewhere_is_told_by_device_and_inode(
    tmp_path, monkeypatch, out, source
):
    """A link that is not followed stands for a bind mount: other path, same device and inode."""
    folder = tmp_path / "deep"
    (folder / "in").mkdir(parents=True)
    (folder / "in" / "a").touch()
    (tmp_path / "mount").symlink_to(folder / "in")
    (tmp_path / "whole").symlink_to(folder)
    monkeypatch.setattr(Path, "resolve", Path.absolute)
    paths = [tmp_path / path if path[0] in "mw" else folder / path for path in (out, source)]
    with pytest.raises(InputError, match="name a folder apart"):
        refuse_overlap(paths[0], [paths[1]])
    refuse_overlap(tmp_path / "mounted", [paths[1]])


@pytest.mark.parametrize("part", ["..", "", ".", "a/b", "/etc", "a\x00", "a\\b", "x" * 300])
def test_paths_that_leave_the_folder_are_refused(tmp_path, part):
    with pytest.raises(InputError, match="name of an output"):
        output_path(tmp_path, "meshes", part)


def test_links_do_not_lead_out_of_the_folder(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "originals").mkdir()
    (tmp_path / "out" / "meshes").symlink_to(tmp_path / "originals")
    with pytest.raises(InputError, match="leads out of"):
        write(tmp_path / "out", {"meshes/a": "1"})
    assert not list((tmp_path / "originals").iterdir())


def test_what_a_killed_run_left_goes_with_the_next(tmp_path):
    script = (
        "import os, sys; from data_tools.io.output_folder import OutputFolder\n"
        "with OutputFolder.open(sys.argv[1], writer='t') as output:\n"
        "    output.stage('a').write_text('half'); os._exit(9)"
    )
    subprocess.run([sys.executable, "-c", script, str(tmp_path)], check=False)
    assert (tmp_path / BOOKS / "staging" / "a").exists()
    write(tmp_path, {"summary": "1"})
    assert sorted(p.name for p in (tmp_path / BOOKS).iterdir()) == ["lock", MANIFEST_FILE]


def is_tidy(folder):
    """Whether nothing but the manifest, and a lock that a killed run left, is in the books."""
    return {p.name for p in (folder / BOOKS).iterdir()} <= {"lock", MANIFEST_FILE}


class Interrupted(BaseException):
    """Ends a run as a signal would."""


def interrupt_after(monkeypatch, num):
    """End a run when it is about to change the folder for the ``num``-th time, counted from 0."""
    numbers = count()

    def guarded(change):
        def guard(*given, **how):
            if Path(given[0]).name != "lock" and next(numbers) == num:
                raise Interrupted
            return change(*given, **how)

        return guard

    for name in ("replace", "rename", "link", "unlink"):
        monkeypatch.setattr(os, name, guarded(getattr(os, name)))


#: How often the run of the next test changes the folder; a file that is replaced takes four changes.
NUM_CHANGES = 14


@pytest.mark.parametrize("after", range(NUM_CHANGES))
def test_a_run_that_ends_between_two_changes_loses_nothing_and_can_be_repeated(
    tmp_path, monkeypatch, after
):
    former, new = {"summary": "1", "a": "1", "b": "1"}, {"summary": "2", "a": "2", "c": "2"}
    write(tmp_path, former)
    (tmp_path / "mine").write_text("mine")
    interrupt_after(monkeypatch, after)
    with pytest.raises(Interrupted):
        write(tmp_path, new)
    found = contents(tmp_path)
    assert found["mine"] == "mine"
    assert found.get("summary") != "2" or found["a"] == found["c"] == "2"  # it comes last
    monkeypatch.undo()
    with OutputFolder.open(tmp_path, writer="other"):
        whole = new if after else former
        assert contents(tmp_path) == whole | {"mine": "mine"}, (
            "whoever comes next finishes what had begun"
        )
    assert is_tidy(tmp_path)
    write(tmp_path, {"summary": "3", "a": "3"})
    assert contents(tmp_path) == {"summary": "3", "a": "3", "mine": "mine"}


def test_no_change_goes_uncounted(tmp_path, monkeypatch):
    write(tmp_path, {"summary": "1", "a": "1", "b": "1"})
    interrupt_after(monkeypatch, NUM_CHANGES)
    write(tmp_path, {"summary": "2", "a": "2", "c": "2"})


@pytest.mark.parametrize("change", ["staged", "in place", "foreign"])
def test_what_is_not_whole_any_more_is_not_finished(tmp_path, monkeypatch, change):
    write(tmp_path, {"summary": "1", "a": "1"})
    interrupt_after(monkeypatch, 5)  # the summary is away, and a is new
    with pytest.raises(Interrupted):
        write(tmp_path, {"summary": "2", "a": "2", "c": "2"})
    monkeypatch.undo()
    assert contents(tmp_path) == {"a": "2"}
    changed = {"staged": f"{BOOKS}/staging/c", "in place": "a", "foreign": "c"}[change]
    (tmp_path / changed).write_text("changed")
    with OutputFolder.open(tmp_path, writer="other"):
        pass
    assert "summary" not in contents(tmp_path)
    assert contents(tmp_path).get("c") == ("changed" if change == "foreign" else None)
    assert is_tidy(tmp_path)


def in_the_window(monkeypatch, change):
    """Change the folder once between the check of what lies there and the first move."""
    original, calls = OutputFolder._move, []

    def move(self, *given):
        if not calls:
            calls.append(change())
        original(self, *given)

    monkeypatch.setattr(OutputFolder, "_move", move)


@pytest.mark.parametrize("links", [True, False])
@pytest.mark.parametrize("name", ["report.html", "meshes/a.ply", "summary", "meshes/new.ply"])
def test_what_is_changed_after_the_check_is_kept(tmp_path, monkeypatch, caplog, name, links):
    def refuse(*given, **how):
        raise PermissionError

    files = ["summary", "report.html", "meshes/a.ply"]
    write(tmp_path, dict.fromkeys(files, "1"))
    place = tmp_path / name
    if not links:
        monkeypatch.setattr(os, "link", refuse)
    in_the_window(monkeypatch, lambda: place.write_text("mine"))
    write(tmp_path, dict.fromkeys([*files, "meshes/new.ply"], "2"))
    kept = place.with_name(f"{place.stem}-changed{place.suffix}")
    assert contents(tmp_path) == dict.fromkeys([*files, "meshes/new.ply"], "2") | {
        kept.relative_to(tmp_path).as_posix(): "mine"
    }
    assert f"{place}: was changed while results were written" in caplog.text
    assert kept.name in caplog.text
    assert is_tidy(tmp_path)
    write(tmp_path, dict.fromkeys(files, "3"))
    assert kept.read_text() == "mine"


@pytest.mark.parametrize("kind", ["link", "folder"])
def test_a_link_or_folder_that_takes_the_place_of_a_file_is_kept(tmp_path, monkeypatch, kind):
    out, mine = tmp_path / "out", tmp_path / "mine"
    write(out, {"summary": "1", "report": "1"})
    mine.write_text("mine")

    def change():
        (out / "report").unlink()
        if kind == "link":
            (out / "report").symlink_to(mine)
        else:
            (out / "report").mkdir()
            (out / "report" / "deep").write_text("mine")

    in_the_window(monkeypatch, change)
    write(out, {"summary": "2", "report": "2"})
    kept = out / "report-changed"
    assert (out / "report").read_text() == "2"
    assert (kept if kind == "link" else kept / "deep").read_text() == "mine"
    assert kept.is_symlink() == (kind == "link")


def test_a_changed_file_that_is_no_longer_written_stays_where_it_is(tmp_path, monkeypatch, caplog):
    write(tmp_path, {"summary": "1", "old/report": "1"})
    original = os.rename

    def rename(source, target):  # later than any check by path
        if Path(source).name == "report":
            Path(source).write_text("mine")
        original(source, target)

    monkeypatch.setattr(os, "rename", rename)
    write(tmp_path, {"summary": "2"})
    assert contents(tmp_path) == {"summary": "2", "old/report": "mine"}
    assert not caplog.text


def test_a_file_that_appears_where_one_was_moved_away_is_kept(tmp_path, monkeypatch):
    write(tmp_path, {"summary": "1", "report": "1"})
    original, texts = os.rename, iter(["first", "second"])

    def rename(source, target):
        original(source, target)
        if Path(source).name == "report" and (text := next(texts, None)):
            Path(source).write_text(text)

    monkeypatch.setattr(os, "rename", rename)
    write(tmp_path, {"summary": "2", "report": "2"})
    assert contents(tmp_path) == {
        "summary": "2",
        "report": "2",
        "report-changed": "first",
        "report-changed2": "second",
    }


@pytest.mark.parametrize("after", range(2, NUM_CHANGES + 3))
def test_a_changed_file_outlives_an_interruption_at_any_moment(tmp_path, monkeypatch, after):
    write(tmp_path, {"summary": "1", "a": "1", "b": "1"})
    in_the_window(monkeypatch, lambda: (tmp_path / "a").write_text("mine"))
    interrupt_after(monkeypatch, after)
    try:
        write(tmp_path, {"summary": "2", "a": "2", "c": "2"})
    except Interrupted:
        monkeypatch.undo()
        with OutputFolder.open(tmp_path, writer="other"):
            pass
    assert "mine" in contents(tmp_path).values()
    assert is_tidy(tmp_path)


def test_what_is_set_aside_does_not_leave_the_folder(tmp_path):
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    write(out, {"summary": "1"})
    elsewhere.mkdir()
    (out / BOOKS / "former").symlink_to(elsewhere)
    with pytest.raises(InputError, match="leads out of"):
        write(out, {"summary": "2"})
    assert contents(tmp_path) == {"out/summary": "1"}


def test_two_runs_do_not_share_a_folder(tmp_path):
    with (
        OutputFolder.open(tmp_path, writer="t"),
        pytest.raises(InputError, match="another run"),
        OutputFolder.open(tmp_path, writer="t"),
    ):
        pytest.fail("was opened")
    write(tmp_path, {"summary": "1"})


@pytest.mark.parametrize(
    "content",
    [
        "[" * 100_000,
        '{"version": ' + "9" * 10_000 + "}",
        "[]",
        '{"version": 2, "files": {}}',
        '{"version": 1, "files": {"../x": {"writer": "test", "digests": []}}}',
        '{"version": 1, "files": {"/x": {"writer": "test", "digests": []}}}',
        '{"version": 1, "files": {"x": []}}',
        '{"version": 1, "files": {"../x": {"writer": "test", "digests": []}}, "pending": {"new": ["../x"]}}',
    ],
)
def test_a_manifest_is_not_believed(tmp_path, content):
    write(tmp_path / "out", {"summary": "1"})
    (tmp_path / "x").write_text("mine")
    (tmp_path / "out" / BOOKS / MANIFEST_FILE).write_text(content)
    with pytest.raises(InputError, match=r"manifest|name of an output"):
        write(tmp_path / "out", {"summary": "2"})
    assert contents(tmp_path) == {"out/summary": "1", "x": "mine"}


@pytest.mark.parametrize(
    "pending", [1, [], {"new": 1}, {"new": [[]], "stale": [], "last": None}, {"new": ["../x"]}]
)
def test_a_pending_publication_is_not_believed(tmp_path, pending):
    write(tmp_path / "out", {"summary": "1"})
    (tmp_path / "x").write_text("mine")
    manifest = tmp_path / "out" / BOOKS / MANIFEST_FILE
    manifest.write_text(json.dumps(json.loads(manifest.read_text()) | {"pending": pending}))
    write(tmp_path / "out", {"summary": "2"})
    assert contents(tmp_path) == {"out/summary": "2", "x": "mine"}


def test_stems_are_names_of_files():
    assert file_stem("..") == "shape"
    assert file_stems(["a", "A", "a-2"]) == ["a", "A-2", "a-2-2"]
    assert file_stem("../../x") == "_.._x"
    assert file_stem("\udcff e").isascii()


def test_long_stems_are_cut_and_stay_distinct():
    names = ["é" * 150 + "a", "é" * 150 + "b", "x" * 200]
    stems = file_stems(names)
    assert len(set(stems)) == 3
    assert max(len(stem.encode()) for stem in stems) <= 200
    assert stems[2] == names[2]


def test_a_file_where_a_folder_of_results_belongs_is_refused_before_the_work(tmp_path):
    (tmp_path / "meshes").write_text("mine")
    with (
        OutputFolder.open(tmp_path, writer="align") as output,
        pytest.raises(InputError, match="meshes: is in the place"),
    ):
        output.refuse_foreign(["meshes/a.ply"])


def test_names_that_this_system_cannot_write_are_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be the name of an output in this locale"):
        output_path(tmp_path, "\ud800.ply")


@pytest.mark.parametrize("to", ["loop/x", "x/" * 3000])
def test_loops_of_links_and_paths_that_are_too_long_are_refused(tmp_path, to):
    (tmp_path / "loop").symlink_to(tmp_path / "pool")
    (tmp_path / "pool").symlink_to(tmp_path / "loop")
    with pytest.raises(InputError, match=r"cannot be used \(.*\); name another place"):
        write(tmp_path / to, {"summary": "1"})
