"""The idle loop as a process of its own, and its counters against what the system says of known work."""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack

import numpy as np
import pytest

from contract.errors import StillwakeError
from firmware_sim.ecu.real_time.privileges import Wanted
from firmware_sim.latency.idle_loop import Waiting, main, run, stolen_time, wanted
from firmware_sim.latency.idle_times import IdleStage, IdleTimes
from tests.firmware_sim.latency.conftest import MS, PERIOD

HAS_SCHEDSTAT = os.path.exists("/proc/self/schedstat")


def test_deadlines_are_a_period_apart_and_waking_is_never_early():
    rows = run(2 * MS, [lambda: 0, lambda: 0, lambda: 0], lambda: False, longest=30)
    steps = np.diff(rows[:, IdleStage.SCHEDULED])
    np.testing.assert_array_equal(steps, 2 * MS * np.diff(rows[:, IdleStage.PERIOD]))
    assert (rows[:, IdleStage.WOKE] >= rows[:, IdleStage.SCHEDULED]).all()


def test_counters_are_noted_as_what_was_added():
    values = iter([5, 0, 0, 7, 0, 0, 7, 1, 0, 10, 1, 0])
    rows = run(MS, [lambda: next(values)] * 3, lambda: False, longest=3)
    assert rows[:, IdleStage.ECU_WAITED :].tolist() == [[2, 0, 0], [0, 1, 0], [3, 0, 0]]


def test_stops_when_asked():
    asked = iter([False, False, True])
    assert len(run(MS, [lambda: 0] * 3, lambda: next(asked), longest=10)) == 2


@pytest.mark.skipif(not HAS_SCHEDSTAT, reason="this system does not tell how long a thread waited")
def test_a_process_that_shares_its_processor_with_others_waited():
    # Three loops that want all of one processor: each waits two thirds of the time, less where its share was larger.
    command = [sys.executable, "-c", "while True: pass"]
    here = min(os.sched_getaffinity(0))
    busy = [subprocess.Popen(command) for _ in range(3)]
    try:
        for process in busy:
            os.sched_setaffinity(process.pid, {here})
        with ExitStack() as stack:
            waited = Waiting(busy[0].pid, stack)
            assert waited.is_known
            began = time.monotonic_ns()
            time.sleep(1.0)
            found, passed = waited(), time.monotonic_ns() - began
        assert 0.2 * passed < found < 1.1 * passed
    finally:
        for process in busy:
            process.kill()
            process.wait()


@pytest.mark.skipif(not HAS_SCHEDSTAT, reason="this system does not tell how long a thread waited")
def test_threads_of_no_urgency_are_left_out():
    ended = threading.Event()
    others = [threading.Thread(target=ended.wait) for _ in range(3)]
    for other in others:
        other.start()
    try:
        with ExitStack() as stack:
            waiting = Waiting(os.getpid(), stack)
            assert list(waiting._readers) == [os.getpid()]
    finally:
        ended.set()


def test_of_a_process_that_is_gone_nothing_is_known():
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    with ExitStack() as stack:
        waiting = Waiting(gone.pid, stack)
        assert not waiting.is_known
        assert waiting() == 0


@pytest.mark.skipif(not os.path.exists("/proc/stat"), reason="Linux tells of stolen time")
def test_stolen_time_is_the_eighth_number_of_the_first_line():
    with ExitStack() as stack, open("/proc/stat", encoding="ascii") as file:
        read = stolen_time(stack)
        assert read is not None
        before = int(file.readline().split()[8]) * 10**9 // os.sysconf("SC_CLK_TCK")
        assert before <= read() <= before + 10**9


@pytest.mark.processes
def test_as_a_process_it_writes_its_table_when_it_is_told_to_end(tmp_path):
    path = tmp_path / "idle.npz"
    command = [
        sys.executable,
        "-m",
        "firmware_sim.latency.idle_loop",
        str(path),
        str(PERIOD),
        "1000",
        "any",
        str(os.getpid()),
    ]
    process = subprocess.Popen([*command, str(os.getppid())], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert "no garbage collection" in process.stdout.readline()  # it is told when it begins
    time.sleep(0.5)
    process.send_signal(signal.SIGTERM)
    assert process.wait(10.0) == 0
    process.stdout.close()
    found = IdleTimes.load(path)
    assert len(found.rows) >= 10  # of 25 in half a second
    assert found.knows_waiting == HAS_SCHEDSTAT


@pytest.fixture
def handlers_restored():
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("handlers_restored")
@pytest.mark.parametrize(("arguments", "rows"), [(["any", str(os.getpid())], 3), (["processor"], 0)])
def test_a_tied_loop_that_the_ecu_can_hold_up_is_no_witness(tmp_path, monkeypatch, arguments, rows):
    def refused(*_arguments):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refused)
    here = str(min(os.sched_getaffinity(0)))
    path = tmp_path / "idle.npz"
    main([str(path), str(MS), "3", *(here if one == "processor" else one for one in arguments)])
    assert len(IdleTimes.load(path).rows) == rows


def test_idle_loops_go_before_the_ecu():
    # With the same priority, a loop tied to the ECU's processor would wait for a slow plan of ours, and excuse it.
    assert wanted("any").priority > Wanted().priority
    assert wanted("1") == Wanted(priority=wanted("any").priority, processor=1)


def test_saved_and_loaded_alike(tables, tmp_path):
    idle = tables(7).idle_times
    idle.save(tmp_path / "a.npz")
    found = IdleTimes.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(found.rows, idle.rows)
    assert found.knows_waiting


def test_another_file_is_refused(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"no table")
    with pytest.raises(StillwakeError, match="no table of an idle loop"):
        IdleTimes.load(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", columns=np.array(["period"]), rows=np.zeros((1, 1), np.int64), knows_waiting=True)
    with pytest.raises(StillwakeError, match="columns period, scheduled"):
        IdleTimes.load(tmp_path / "b.npz")


def test_periods_left_out_count_until_the_next_waking(tables):
    run_ = tables(50)
    run_.idle = np.delete(run_.idle, [20, 21], axis=0)
    late = run_.idle_times.late(PERIOD)
    assert len(late) == 50
    assert late[19:23].tolist() == [80_000, 80_000 + 2 * PERIOD, 80_000 + PERIOD, 80_000]
