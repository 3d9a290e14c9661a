"""The idle loop: its deadlines, its table, and the process."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from contract.errors import StillwakeError
from firmware_sim.ecu.real_time.privileges import Wanted
from firmware_sim.latency.idle_loop import WANTED, IdleStage, lateness, load, run, save
from tests.firmware_sim.latency.conftest import MS, PERIOD


def test_deadlines_are_a_period_apart_and_waking_is_never_early():
    rows = run(2 * MS, lambda: False, longest=30)
    steps = np.diff(rows[:, IdleStage.SCHEDULED])
    np.testing.assert_array_equal(steps, 2 * MS * np.diff(rows[:, IdleStage.PERIOD]))
    assert (rows[:, IdleStage.WOKE] >= rows[:, IdleStage.SCHEDULED]).all()
    asked = iter([False, False, True])
    assert len(run(MS, lambda: next(asked), longest=10)) == 2


@pytest.mark.processes
def test_as_a_process_it_writes_its_table_when_it_is_asked_to_end(tmp_path):
    # With the ECU's priority, the work that it is compared with would delay it.
    assert WANTED.priority > Wanted().priority
    path = tmp_path / "idle.npz"
    command = [sys.executable, "-m", "firmware_sim.latency.idle_loop", str(path), str(PERIOD), "1000"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert "no garbage collection" in process.stdout.readline()  # printed when it begins
    time.sleep(0.5)
    process.send_signal(signal.SIGTERM)
    assert process.wait(10.0) == 0
    process.stdout.close()
    assert len(load(path)) >= 10  # of 25 in half a second


def test_a_table_is_read_as_it_was_written_and_another_file_is_refused(tables, tmp_path):
    save(tables(7).idle, tmp_path / "a.npz")
    np.testing.assert_array_equal(load(tmp_path / "a.npz"), tables(7).idle)
    (tmp_path / "b.npz").write_bytes(b"no table")
    with pytest.raises(StillwakeError, match="no table of an idle loop"):
        load(tmp_path / "b.npz")
    np.savez(tmp_path / "c.npz", columns=np.array(["period"]), rows=np.zeros((1, 1), np.int64))
    with pytest.raises(StillwakeError, match="columns period, scheduled"):
        load(tmp_path / "c.npz")


def test_periods_left_out_count_until_the_next_waking(tables):
    late = lateness(np.delete(tables(50).idle, [20, 21], axis=0), PERIOD)
    assert len(late) == 50
    assert late[19:23].tolist() == [80_000, 80_000 + 2 * PERIOD, 80_000 + PERIOD, 80_000]
