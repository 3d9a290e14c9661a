"""Sleeping until an instant: never too early. How late is the machine's affair and is not asserted."""

import os
import signal
import threading
import time

import pytest

from firmware_sim.ecu.real_time import clock


@pytest.fixture(params=["by instant", "by duration"])
def sleeping(request, monkeypatch):
    if request.param == "by duration":
        monkeypatch.setattr(clock, "_sleep", clock._sleep_by_duration)
    return clock.sleep_until


@pytest.mark.parametrize("spin_ns", [0, 500_000, 10**9])
def test_it_never_returns_early(sleeping, spin_ns):
    for wait in (0, 1, 1_000, 100_000, 3_000_000):
        due = time.monotonic_ns() + wait
        sleeping(due, spin_ns=spin_ns)
        assert time.monotonic_ns() >= due


def test_an_instant_that_has_passed_is_not_waited_for(sleeping, monkeypatch):
    monkeypatch.setattr(clock, "_sleep", lambda until: pytest.fail("slept"))
    sleeping(time.monotonic_ns() - 1)
    sleeping(0)


def test_a_signal_neither_ends_the_sleep_nor_is_lost(sleeping, monkeypatch):
    seen = []
    before = signal.signal(signal.SIGUSR1, lambda number, frame: seen.append(time.monotonic_ns()))
    try:
        due = time.monotonic_ns() + 200_000_000
        threading.Timer(0.02, os.kill, (os.getpid(), signal.SIGUSR1)).start()
        sleeping(due)
        assert time.monotonic_ns() >= due
        # Its handler ran while the sleep lasted.
        assert len(seen) == 1
        assert seen[0] < due
    finally:
        signal.signal(signal.SIGUSR1, before)
