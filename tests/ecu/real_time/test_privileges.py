"""Privileges: what the operating system itself reports while they are held, and afterwards."""

import ctypes
import gc
import os
import re
import resource
import threading
from pathlib import Path

import pytest

from ecu.real_time.privileges import Privilege, Wanted, in_words, step_back, taken
from tests.each import each


def locked_kib() -> int:
    line = re.search(r"VmLck:\s+(\d+) kB", Path("/proc/self/status").read_text())
    assert line is not None
    return int(line[1])


def state():
    slack = ctypes.CDLL(None).prctl(30, 0, 0, 0, 0)
    return os.sched_getscheduler(0), gc.isenabled(), gc.get_freeze_count() > 0, slack


@pytest.mark.slow
def test_what_is_reported_as_granted_is_and_all_is_given_back():
    before = state()
    with taken(Wanted(priority=10)) as held:
        granted = {item.what: not item.refused_because for item in held}
        assert set(granted) == {"timer slack 1 ns", "no garbage collection", "memory locked", "SCHED_FIFO 10"}
        assert granted["no garbage collection"] and not gc.isenabled() and gc.get_freeze_count() > 0
        assert granted["SCHED_FIFO 10"] == (os.sched_getscheduler(0) == os.SCHED_FIFO)
        assert granted["memory locked"] == (locked_kib() > 0)
    assert (locked_kib(), state()) == (0, before)


@each("priority", [0, 5])
def test_a_thread_that_steps_back_is_below_the_one_that_started_it(priority):
    found = []

    def look() -> None:
        step_back()
        found.append((os.sched_getscheduler(0), os.sched_getparam(0).sched_priority))

    with taken(Wanted(priority=priority, lock_memory=False)) as privileges:
        thread = threading.Thread(target=look)
        thread.start()
        thread.join()
    has_priority = Privilege(f"SCHED_FIFO {priority}") in privileges
    assert found == [(os.SCHED_FIFO, 1) if has_priority else (os.SCHED_OTHER, 0)]


def test_a_refusal_names_its_cause(monkeypatch):
    def refuse(*arguments):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with taken(Wanted(priority=99, lock_memory=False, without_collector=False)) as held:
        by_name = {item.what: item for item in held}
    assert by_name["SCHED_FIFO 99"] == Privilege("SCHED_FIFO 99", "operation not permitted")
    assert "not granted: " in in_words(held)
    assert "SCHED_FIFO 99 (operation not permitted)" in in_words(held)


def test_under_a_limit_what_comes_later_is_not_locked(monkeypatch):
    """It could not be allocated: a process that runs must not run out of memory for its privileges."""
    calls = []

    def call(name, *arguments):
        calls.append((name, *arguments))
        return 0

    monkeypatch.setattr("ecu.real_time.privileges._call", call)
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(resource, "getrlimit", lambda which: (8 << 20, 8 << 20))
    with taken(Wanted(priority=0, without_collector=False)):
        pass
    assert [item for item in calls if item[0] == "mlockall"] == [("mlockall", 1)]
