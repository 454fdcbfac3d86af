"""What a fresh process took, what is installed, and the lines of the table of speed."""

import sys

import pytest

from data_tools.errors import CollectionError
from experiments.peers.speed import ALIGNED, COMMANDS, GOALS, PM_SDP_SIZES, installed_mib, run_fresh

_BUSY = "total = 0\nfor i in range({}): total += i * i"


def test_a_process_is_charged_for_its_own_work_and_that_of_its_children():
    child = "import subprocess, sys; subprocess.run([sys.executable, '-c', sys.argv[1]])"
    idle = run_fresh([sys.executable, "-c", "pass"])
    alone = run_fresh([sys.executable, "-c", _BUSY.format(6_000_000)])
    inside = run_fresh([sys.executable, "-c", child, _BUSY.format(6_000_000)])
    assert alone.processor_s > 2 * idle.processor_s
    assert inside.processor_s > alone.processor_s / 2


def test_memory_is_that_of_the_process_alone():
    ballast = bytearray(200 * 2**20)
    small = run_fresh([sys.executable, "-c", "import time; time.sleep(0.2)"])
    large = run_fresh(
        [sys.executable, "-c", "import time; x = b'1' * (300 * 2**20); time.sleep(0.2)"]
    )
    assert small.memory_mib < 100 < 300 <= large.memory_mib
    assert len(ballast) > 0


def test_a_command_that_fails_says_what_it_printed():
    with pytest.raises(CollectionError, match=r"ended with 3: .*lost"):
        run_fresh([sys.executable, "-c", "import sys; print('lost'); sys.exit(3)"])


def test_processes_get_one_thread():
    check = "import os, sys; sys.exit(os.environ['OMP_NUM_THREADS'] != '1')"
    run_fresh([sys.executable, "-c", check])


def test_installed_size_counts_what_is_required_and_nothing_twice():
    assert installed_mib("collalign") > installed_mib("scipy") > installed_mib("numpy") > 1.0
    assert installed_mib("no such distribution") == 0.0


def test_every_line_has_a_goal():
    relaxations = {f"PM-SDP of {num} points" for num in PM_SDP_SIZES}
    assert set(GOALS) == {*ALIGNED, *COMMANDS, *relaxations, "installed"}
