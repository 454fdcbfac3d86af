"""What a fresh process took, what is installed, and the lines of the table of speed."""

import sys

from experiments.peers.speed import ALIGNED, COMMANDS, GOALS, PM_SDP_SIZES, run_fresh

_BUSY = "total = 0\nfor i in range({}): total += i * i"


def test_a_process_is_charged_for_its_own_work_and_that_of_its_children():
    child = "import subprocess, sys; subprocess.run([sys.executable, '-c', sys.argv[1]])"
    idle = run_fresh([sys.executable, "-c", "pass"])
    alone = run_fresh([sys.executable, "-c", _BUSY.format(6_000_000)])
    inside = run_fresh([sys.executable, "-c", child, _BUSY.format(6_000_000)])
    assert alone.processor_s > 2 * idle.processor_s
    assert inside.processor_s > alone.processor_s / 2


def test_every_line_has_a_goal():
    relaxations = {f"PM-SDP of {num} points" for num in PM_SDP_SIZES}
    assert set(GOALS) == {*ALIGNED, *COMMANDS, *relaxations, "installed"}
