import os
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing, suppress

import numpy as np
import pytest

from collalign.engine.store import Store
from collalign.engine.store_file import FORMAT_VERSION
from data_tools.errors import StoreError

RECORD = {"R": np.eye(3), "energy": 0.25, "names": ["a", "b"]}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.store"


def test_records_survive_closing(path):
    with Store.open(path) as store:
        store.put("pairs", "k", RECORD, label="a ~ b", seconds=0.5)
        store.put("pairs", "k", RECORD | {"energy": 0.5}, label="a ~ b", seconds=1.5)
    with Store.open(path) as store:
        found = store.get("pairs", "k")
        assert found is not None
        assert found["energy"] == 0.5
        assert (found["R"] == np.eye(3)).all()
        assert store.get("pairs", "other") is None
        assert store.get("shapes", "k") is None
        assert store.median_seconds("pairs") == 1.5
        assert np.isnan(store.median_seconds("shapes"))


def test_records_that_must_be_there_are_missed(path):
    with Store.open(path) as store:
        store.put("pairs", "k", RECORD)
        assert store.require("pairs", "k")["energy"] == 0.25
        with pytest.raises(StoreError, match="has vanished"):
            store.require("pairs", "other")


def test_notes_are_kept_replaced_and_forgotten(path):
    with Store.open(path) as store:
        store.set_note("stage", "pairs")
        store.set_note("stage", "outputs")
        store.set_note("files", "7")
        store.set_note("gone", "x")
        store.set_note("gone", "")
    with Store.open(path, read_only=True) as store:
        assert store.notes() == {"files": "7", "stage": "outputs"}


def counts(*numbers):
    return dict(zip(("planned", "done", "failed", "left"), numbers, strict=True))


def test_status_counts_the_plan(path):
    with Store.open(path) as store:
        store.plan("pairs", {"a": "1 ~ 2", "b": "1 ~ 3", "c": "2 ~ 3", "d": ""})
        store.put("pairs", "a", RECORD)
        store.put("pairs", "from another run", RECORD)
        store.put_failure("pairs", "b", "no answer")
        store.put_failure("pairs", "c", "died", crashed=True)
        assert store.status()["shapes"] == counts(0, 0, 0, 0)
        assert store.status()["pairs"] == counts(4, 1, 2, 1)
        store.put("pairs", "c", RECORD)
        assert store.status()["pairs"] == counts(4, 2, 1, 1)
        store.unplan("pairs", ["b", "d"])
        assert store.status()["pairs"] == counts(2, 2, 0, 0)
        store.plan("pairs", {"d": "", "a": "again"})
        assert store.status()["pairs"] == counts(3, 2, 0, 1)
    with Store.open(path) as store:
        store.plan("pairs", {"a": ""})
        assert store.status()["pairs"] == counts(1, 1, 0, 0)


def test_pruning_keeps_what_the_last_plan_of_each_kind_names(path):
    with Store.open(path) as store:
        for key in ("a", "b", "c"):
            store.put("pairs", key, RECORD)
            store.put("shapes", key, RECORD)
        store.put_failure("pairs", "d", "no answer")
        store.put_failure("pairs", "e", "no answer")
        store.plan("pairs", {"a": "", "d": "", "missing": ""})
        assert store.prune() == 2
        assert store.keys("pairs") == {"a"}
        assert store.failures("pairs").keys() == {"d"}
        assert store.keys("shapes") == {"a", "b", "c"}  # nobody has asked for shapes yet
        assert store.prune() == 0
        assert store.get("pairs", "a") is not None


def test_missing_tries_crashes_again_but_not_errors():
    with Store.memory() as store:
        store.put("pairs", "done", RECORD)
        store.put_failure("pairs", "raised", "no answer", label="x ~ y")
        store.put_failure("pairs", "crashed", "died", crashed=True)
        keys = ["new", "done", "crashed", "raised"]
        assert store.missing("pairs", keys) == ["new", "crashed"]
        assert store.missing("pairs", keys, again=True) == ["new", "crashed", "raised"]
        assert store.failures("pairs")["raised"].label == "x ~ y"


def test_a_second_writer_is_refused_and_a_reader_is_not(path):
    with Store.open(path) as store:
        store.put("pairs", "k", RECORD)
        with pytest.raises(StoreError, match="another run is writing"):
            Store.open(path)
        with Store.open(path, read_only=True) as reader:
            assert reader.keys("pairs") == {"k"}
            with pytest.raises(StoreError, match="reading only"):
                reader.put("pairs", "l", RECORD)
    Store.open(path).close()


def test_a_killed_writer_leaves_its_records_and_no_lock(path):
    script = (
        "import os, sys; from collalign.engine.store import Store\n"
        "store = Store.open(sys.argv[1])\n"
        "for i in range(50): store.put('pairs', str(i), {'i': i})\n"
        "print('ready', flush=True)\n"
        "while True: i += 1; store.put('pairs', str(i), {'i': i})\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script, str(path)], stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        os.kill(process.pid, signal.SIGKILL)
    with Store.open(path) as store:
        keys = store.keys("pairs")
        assert len(keys) >= 50
        assert keys == {str(i) for i in range(len(keys))}
        assert all(store.get("pairs", key) == {"i": int(key)} for key in keys)


def tamper(path, *statements):
    connection = sqlite3.connect(path)
    for statement in statements:
        connection.execute(statement)
    connection.commit()
    connection.close()


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE pairs SET record = x'80'",
        "UPDATE pairs SET record = 'text'",
        "UPDATE pairs SET record = substr(record, 1, length(record) - 1) || x'7f'",
        "UPDATE pairs SET digest = x'00'",
        "UPDATE pairs SET key = CASE key WHEN 'k' THEN 'l' ELSE 'k' END",
    ],
)
def test_damaged_rows_are_refused_and_made_anew_by_the_next_run(path, statement):
    with Store.open(path) as store:
        store.put("pairs", "k", RECORD)
        assert store.get("pairs", "k") is not None
    tamper(path, statement)
    with Store.open(path) as store:
        key = next(iter(store.keys("pairs")))
        with pytest.raises(StoreError, match="damaged; run the same command again"):
            store.get("pairs", key)
        assert store.missing("pairs", [key]) == [key]


@pytest.mark.parametrize(
    ("statement", "reason"),
    [
        ("PRAGMA user_version = 99", "format version 99"),
        ("PRAGMA application_id = 7", "not a store"),
        ("CREATE TABLE more (x)", "tables"),
        ("CREATE TRIGGER t AFTER INSERT ON pairs BEGIN DELETE FROM shapes; END", "tables"),
        ("DROP TABLE meta", "tables"),
    ],
)
def test_files_of_another_layout_are_refused(path, statement, reason):
    Store.open(path).close()
    tamper(path, statement)
    for read_only in (True, False):
        with pytest.raises(StoreError, match=reason):
            Store.open(path, read_only=read_only)


def test_text_that_is_not_unicode_is_refused_or_read(path):
    with Store.open(path) as store:
        store.put_failure("pairs", "k", "took too long")
    content = path.read_bytes()
    for found, damaged in (
        (b"took too", b"took \xcetoo"[:8]),
        (b"CREATE TABLE plan", b"CREATE TABLE \xceplan"[:17]),
    ):
        path.write_bytes(content.replace(found, damaged))
        with suppress(StoreError), Store.open(path, read_only=True) as store:
            assert "took" in store.failures("pairs")["k"].reason


def test_a_refused_store_is_not_left_locked(path):
    Store.open(path).close()
    tamper(path, "PRAGMA user_version = 99")
    with pytest.raises(StoreError):
        Store.open(path)
    tamper(path, f"PRAGMA user_version = {FORMAT_VERSION}")
    Store.open(path).close()


@pytest.mark.parametrize("key", ["", "x" * 2000, 7])
def test_impossible_keys_and_kinds_are_refused(key):
    with Store.memory() as store:
        with pytest.raises(ValueError, match="key"):
            store.put("pairs", key, RECORD)
        with pytest.raises(ValueError, match="kind"):
            store.get("pairs; DROP TABLE pairs", "k")


def test_names_that_are_not_unicode_are_stored_readably():
    with Store.memory() as store:
        store.put("shapes", "k", RECORD, label="tooth\udcff")
        store.put_failure("shapes", "l", "broken: tooth\udcff", label="tooth\udcff")
        store.plan("shapes", {"k": "tooth\udcff"})
        assert store.failures("shapes")["l"].reason == "broken: tooth?"


def test_somebody_elses_files_are_not_touched(tmp_path):
    database = tmp_path / "mine.sqlite"
    with sqlite3.connect(database) as connection:
        connection.execute("CREATE TABLE mine (x)")
    connection.close()
    before = database.read_bytes()
    with pytest.raises(StoreError, match="not a store of this program"):
        Store.open(database)
    assert database.read_bytes() == before
    lock = tmp_path / "poetry.lock"
    lock.write_text("# a lock file of another tool\n")
    Store.open(tmp_path / "poetry").close()
    assert lock.read_text() == "# a lock file of another tool\n"


@pytest.mark.parametrize("ending", ["-wal", "-journal", "-shm"])
@pytest.mark.parametrize("is_there", [False, True])
def test_journals_of_somebody_else_are_not_touched(path, ending, is_there):
    if is_there:
        Store.open(path).close()
    mine = path.with_name(path.name + ending)
    mine.write_text("my notes of the log")
    with pytest.raises(StoreError, match=rf"{ending}: lies where a journal"):
        Store.open(path)
    assert mine.read_text() == "my notes of the log"
    assert sorted(p.name for p in path.parent.iterdir()) == sorted(
        [path.name] * is_there + [mine.name]
    )


def test_journals_without_a_store_are_not_touched(path):
    with Store.open(path) as store:
        store.put("pairs", "k", RECORD)
        logs = [path.with_name(path.name + ending) for ending in ("-wal", "-shm")]
        left = {log: log.read_bytes() for log in logs}
    path.unlink()
    for log, content in left.items():
        log.write_bytes(content)
    with pytest.raises(StoreError, match="lies where a journal"):
        Store.open(path)
    assert {log: log.read_bytes() for log in logs} == left


def test_a_foreign_database_keeps_its_log(path):
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("CREATE TABLE mine (x)")
        content = {p: p.read_bytes() for p in path.parent.iterdir() if not p.name.endswith("-shm")}
    for file, data in content.items():
        file.write_bytes(data)
    with pytest.raises(StoreError, match="not a store of this program"):
        Store.open(path)
    assert {p: p.read_bytes() for p in path.parent.iterdir()} == content


@pytest.mark.parametrize("content", [None, "text"])
def test_a_refused_store_leaves_no_lock(path, content):
    path.mkdir() if content is None else path.write_text(content)
    with pytest.raises(StoreError):
        Store.open(path)
    assert [p.name for p in path.parent.iterdir()] == [path.name]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes in folders")
def test_a_pipe_is_no_lock_and_no_store(path):
    for pipe in (path.with_name(path.name + ".lock"), path):
        os.mkfifo(pipe)
        with pytest.raises(StoreError, match="regular file"):
            Store.open(path)
        assert pipe.is_fifo()
        pipe.unlink()


def test_a_disk_that_fills_up_during_a_run_is_called_full(tmp_path):
    with Store.open(tmp_path / "a.sqlite") as store:
        store._connection.execute("PRAGMA max_page_count = 20")
        with pytest.raises(StoreError, match="disk is full"):
            store.put("pairs", "a", {"x": bytes(2**20)})


def test_a_backup_of_hard_links_stays_as_it_is(path, tmp_path):
    with Store.open(path) as store:
        store.put("pairs", "k", RECORD)
    os.link(path, tmp_path / "backup")
    before = (tmp_path / "backup").read_bytes()
    with Store.open(path, read_only=True):
        pass
    assert path.samefile(tmp_path / "backup"), "who only reads need not copy"
    for key in ("l", "m"):
        with Store.open(path) as store:
            store.put("pairs", key, RECORD)
            assert store.keys("pairs") >= {"k", key}
    assert (tmp_path / "backup").read_bytes() == before
    assert not [file for file in tmp_path.iterdir() if file.name.startswith(".")]


def test_a_backup_of_a_killed_run_keeps_its_journal(path, tmp_path):
    script = (
        "import os, sys; from collalign.engine.store import Store\n"
        "store = Store.open(sys.argv[1])\n"
        "for i in range(20): store.put('pairs', str(i), {'i': i})\n"
        "os._exit(9)\n"
    )
    subprocess.run([sys.executable, "-c", script, str(path)], check=False)
    backup = tmp_path / "backup"
    backup.mkdir()
    for ending in ("", "-wal"):
        os.link(f"{path}{ending}", backup / f"run.store{ending}")
    before = {file.name: file.read_bytes() for file in backup.iterdir()}
    with Store.open(path) as store:
        store.put("pairs", "k", RECORD)
        assert len(store.keys("pairs")) == 21
    assert {file.name: file.read_bytes() for file in backup.iterdir()} == before
