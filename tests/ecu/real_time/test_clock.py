"""Sleeping until an instant: never too early. How late is the machine's affair and is not asserted."""

import os
import signal
import threading
import time

import pytest

from ecu.real_time import clock


@pytest.fixture(params=["by instant", "by duration"])
def sleeping(request, monkeypatch):
    if request.param == "by duration":
        monkeypatch.setattr(clock, "_sleep", clock._sleep_by_duration)
    return clock.sleep_until


def test_it_never_returns_early(sleeping, monkeypatch):
    for spin_ns in (0, 500_000, 10**9):
        for wait in (0, 1, 100_000, 3_000_000):
            due = time.monotonic_ns() + wait
            sleeping(due, spin_ns=spin_ns)
            assert time.monotonic_ns() >= due, (spin_ns, wait)
    monkeypatch.setattr(clock, "_sleep", lambda until: pytest.fail("slept"))
    sleeping(time.monotonic_ns() - 1)
    sleeping(0)


def test_a_signal_neither_ends_the_sleep_nor_is_lost(sleeping, monkeypatch):
    seen = []
    before = signal.signal(signal.SIGUSR1, lambda number, frame: seen.append(time.monotonic_ns()))
    try:
        due = time.monotonic_ns() + 50_000_000
        threading.Timer(0.01, os.kill, (os.getpid(), signal.SIGUSR1)).start()
        sleeping(due)
        assert time.monotonic_ns() >= due
        # Its handler ran while the sleep lasted.
        assert len(seen) == 1 and seen[0] < due
    finally:
        signal.signal(signal.SIGUSR1, before)
