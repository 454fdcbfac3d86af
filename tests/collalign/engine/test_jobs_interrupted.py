"""Ctrl-C meets worker processes and the pool's threads at the worst instants."""

import os
import signal
import socket
import threading
import time

import pytest
from joblib.externals.loky import reusable_executor
from joblib.externals.loky.backend import fork_exec

from collalign.engine.run_jobs import run_jobs
from tests.faults import is_running
from tests.job_functions import nothing


@pytest.fixture
def no_pool():
    """Workers start anew."""
    if reusable_executor._executor is not None:
        reusable_executor._executor.shutdown(wait=True, kill_workers=True)


def test_workers_that_are_just_starting_end_without_a_word(no_pool, monkeypatch, capfd):
    start, started = fork_exec.fork_exec, []

    def start_and_interrupt(*arguments, **options):
        started.append(start(*arguments, **options))
        os.kill(os.getpid(), signal.SIGINT)  # before the worker is told what to do
        arrived.recv(1)
        return started[-1]

    monkeypatch.setattr(fork_exec, "fork_exec", start_and_interrupt)
    arrived, wakeup = socket.socketpair()
    wakeup.setblocking(False)
    handler = signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # whatever ran before in this process
    former = signal.set_wakeup_fd(wakeup.fileno())
    done = threading.Event()
    other = threading.Thread(target=done.wait)  # Ctrl-C reaches any thread of a process
    other.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            list(run_jobs(nothing, [("a", 1)], num_jobs=2))
    finally:
        signal.set_wakeup_fd(former)
        signal.signal(signal.SIGINT, handler)
        done.set()
        other.join()
    wait_until(lambda: not any(map(is_running, started)))
    assert capfd.readouterr() == ("", "")


def wait_until(holds):
    """Wait for what is certain to happen; give up after minutes."""
    deadline = time.monotonic() + 100.0
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.001)
