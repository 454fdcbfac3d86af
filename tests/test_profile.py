"""The profile times functions by name: each must exist, and a clock counts its time and calls once."""

from __future__ import annotations

import time

import pytest

from tests.benchmarks.profile import KERNELS, Clock, find, our_modules


def test_every_kernel_exists() -> None:
    modules = our_modules()
    for kernel in (kernel for stage in KERNELS.values() for kernel in stage):
        holder, name = find(kernel, modules)
        assert callable(getattr(holder, name))
    with pytest.raises(KeyError):
        find("stages.nowhere:nothing", modules)


def test_a_clock_counts_calls_and_a_nested_call_only_once() -> None:
    def busy(depth: int) -> None:
        until = time.process_time() + 0.02
        while time.process_time() < until:
            pass
        if depth:
            clock.timed(depth - 1)

    clock = Clock(busy)
    clock.timed(1)
    assert clock.num_calls == 2
    assert 0.04 <= clock.seconds < 0.06
