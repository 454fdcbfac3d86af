"""What a fresh process took, what is installed, and the lines of the table of speed."""

from experiments.peers.speed import ALIGNED, COMMANDS, GOALS, PM_SDP_SIZES


def test_every_line_has_a_goal():
    relaxations = {f"PM-SDP of {num} points" for num in PM_SDP_SIZES}
    assert set(GOALS) == {*ALIGNED, *COMMANDS, *relaxations, "installed"}
