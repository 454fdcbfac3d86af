"""What asks a command to end: the first of Ctrl-C, SIGTERM and SIGHUP does, in order."""

import signal
import subprocess
import sys

import pytest

from collalign.console.interruption import interruption_code, orderly_interrupts, was_interrupted


@pytest.fixture(autouse=True)
def usual(monkeypatch):
    """Python's own handlers, whatever started this process."""
    former = {
        number: signal.signal(number, handler)
        for number, handler in (
            (signal.SIGINT, signal.default_int_handler),
            (signal.SIGTERM, signal.SIG_DFL),
            (signal.SIGHUP, signal.SIG_DFL),
        )
    }
    yield
    for number, handler in former.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_the_first_one_interrupts_and_those_of_a_closed_terminal_come_again_in_vain(number, code):
    with orderly_interrupts(until_exit=False):
        assert not was_interrupted()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
        assert (was_interrupted(), interruption_code()) == (True, code)
        for other in (signal.SIGTERM, signal.SIGHUP, signal.SIGHUP, signal.SIGTERM):
            signal.raise_signal(other)
        assert interruption_code() == code
    assert signal.getsignal(signal.SIGHUP) == signal.SIG_DFL


def test_ctrl_c_again_asks_for_patience_and_ends_at_the_third():
    code = (
        "import signal, sys; from collalign.console.interruption import orderly_interrupts\n"
        "with orderly_interrupts(until_exit=True):\n"
        "    try: signal.raise_signal(int(sys.argv[1]))\n"
        "    except KeyboardInterrupt: print('first', flush=True)\n"
        "    signal.raise_signal(signal.SIGINT); print('second', flush=True)\n"
        "    signal.raise_signal(signal.SIGINT); print('third')\n"
    )
    for first, ends in ((signal.SIGINT, 130), (signal.SIGTERM, 143)):
        command = [sys.executable, "-c", code, str(int(first))]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout) == (ends, "first\nsecond\n")
        assert done.stderr == "collalign: ending in order; once more ends it at once\n"


def test_a_command_that_is_run_again_in_the_same_process_has_not_been_interrupted():
    for _ in range(2):
        with orderly_interrupts(until_exit=False):
            assert not was_interrupted()
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
