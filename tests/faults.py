"""Runs a command to its end while killing it, or one of its workers, at random instants."""

import os
import signal
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

#: How a command ends that was asked to.
ENDED_BY_SIGNAL = (-signal.SIGINT, -signal.SIGTERM, 130, 143)


@dataclass
class FaultLog:
    """How often each kind of process was killed, the command was asked to end, and how it ended by itself."""

    parents: int = 0
    workers: int = 0
    signals: int = 0
    endings: list[int] = field(default_factory=list)

    @property
    def kills(self):
        return self.parents + self.workers


def run_with_kills(
    command,
    num_kills,
    rng,
    *,
    delay_s,
    parent_share=0.3,
    resume_codes=(),
    cwd=None,
    num_signals=0,
    check=None,
):
    """Run a command until it ends by itself with code 0, with SIGKILLs, and signals that ask it to end, on the way.

    At most ``num_kills`` of the command and its workers, the command itself with probability ``parent_share``, and
    ``num_signals`` of SIGINT and SIGTERM to the command, uniformly ``delay_s`` apart. The command is started again
    where it was killed, and after exit codes of ``resume_codes``, as a user would where something was left out;
    ``check`` is called whenever it has ended. Any other exit code is a RuntimeError.
    """
    log = FaultLog()
    while True:
        process = subprocess.Popen(
            command, cwd=cwd, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )
        with process:
            asked = _disturb(process, (num_kills, num_signals), rng, log, delay_s, parent_share)
            errors = process.stderr.read().decode(errors="replace") if process.stderr else ""
        if check is not None:
            check()
        if process.returncode == -signal.SIGKILL or (
            asked and process.returncode in ENDED_BY_SIGNAL
        ):
            continue
        log.endings.append(process.returncode)
        if process.returncode in resume_codes:
            continue
        if process.returncode != 0:
            raise RuntimeError(
                f"{command[0]} ended with code {process.returncode}: {errors[-2000:]}"
            )
        return log


def _disturb(process, limits, rng, log, delay_s, parent_share):
    """Kill or signal until the command is gone or has had enough; returns whether it was asked to end."""
    num_kills, num_signals = limits
    while log.kills < num_kills or log.signals < num_signals:
        try:
            process.wait(timeout=rng.uniform(*delay_s))
            return False
        except subprocess.TimeoutExpired:
            pass
        left = np.array([num_kills - log.kills, num_signals - log.signals])
        if rng.random() * left.sum() >= left[0]:
            log.signals += 1
            process.send_signal(int(rng.choice([signal.SIGINT, signal.SIGTERM])))
            return True
        workers = worker_processes(process.pid)
        if rng.random() < parent_share:
            log.parents += 1
            process.kill()
            return False
        if workers:
            log.workers += kill(int(rng.choice(workers)))
    return False


def kill(pid):
    """Kill a process with SIGKILL; returns whether it was there."""
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return False
    return True


def worker_processes(parent):
    """Return the process ids of joblib's workers of a process."""
    found = []
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            parent_pid = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
            words = (entry / "cmdline").read_bytes()
        except OSError:
            continue
        if parent_pid == parent and b"popen_loky" in words:
            found.append(int(entry.name))
    return sorted(found)


def is_running(pid):
    """Whether a process is there, and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False
