"""Functions for the tests of jobs: they live in a module so that worker processes can import them."""

import ctypes
import os
import signal
import time
from pathlib import Path

import numpy as np


def spectrum(payload):
    """Matrix products, decompositions and random numbers: bytes that depend on the number of BLAS threads."""
    rng = np.random.default_rng(payload)
    matrix = rng.standard_normal((120, 120))
    return np.linalg.eigh(matrix @ matrix.T)[1][:, :3].copy()


def positions(record, key):
    return record["positions"]


def look_up(payload, shared):
    return float(shared.made(payload, positions).sum())


def nothing(payload, shared=None):
    return payload


def process_id(payload):
    time.sleep(0.02)
    return os.getpid()


def misbehave(payload):
    """Do what the payload says: return, raise, crash, hang, fill the memory, or be killed or stopped once."""
    action, value = payload
    if action == "return":
        time.sleep(0.01)
    elif action == "raise":
        raise ValueError(f"no answer for {value}")
    elif action == "segfault":
        ctypes.string_at(0)
    elif action == "hang":
        ctypes.PyDLL(None).sleep(60)  # holds the interpreter lock
    elif action == "fill":
        np.ones(2**33)
    elif action == "killed-once" and not Path(value).exists():
        Path(value).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    elif action == "stopped-once" and not Path(value).exists():
        Path(value).touch()
        os.kill(os.getpid(), signal.SIGSTOP)
    return value
