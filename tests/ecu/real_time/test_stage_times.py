"""The table of stages: what is noted is read back; it neither grows nor loses the newest."""

from functools import partial
from itertools import count
from typing import Any

import numpy as np
import pytest

from contract.controller.interface import ControllerError
from contract.errors import StillwakeError
from ecu.real_time.stage_times import NOTHING, EcuStage, StageTimes, TimedController, VehicleStage, load
from tests.ecu.conftest import Answering, RecordingController


def test_what_was_noted_is_read_back_and_the_rest_is_nothing(tmp_path):
    table = StageTimes(EcuStage, periods=3)
    table.begin()
    table.note(EcuStage.PERIOD, 5)
    table.note(EcuStage.SENT, 2**62)
    table.begin()
    table.note(EcuStage.PRESSURE_COUNTER, 0)
    table.save(tmp_path / "ecu.npz")
    first, second = load(tmp_path / "ecu.npz", EcuStage)
    assert (first[EcuStage.SENT], first.sum()) == (2**62, 5 + 2**62 + NOTHING)
    assert second.tolist() == [0] * len(EcuStage)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ecu.npz"]


def test_a_full_table_keeps_the_newest():
    for periods in (1, 4, 7, 9):
        table = StageTimes(VehicleStage, periods=4)
        for period in range(periods):
            table.begin()
            table.note(VehicleStage.PERIOD, period)
            if period == 0:
                table.note(VehicleStage.SAMPLED, 99)
        rows = table.rows()
        assert rows[:, 0].tolist() == list(range(periods))[-4:], periods
        # A row that is used again has nothing of its former period.
        assert rows[:, VehicleStage.SAMPLED].sum() == (99 if periods <= 4 else 0), periods


def test_another_file_is_refused(tmp_path):
    StageTimes(VehicleStage, periods=1).save(tmp_path / "vehicle.npz")
    (tmp_path / "text.npz").write_text("no archive")
    np.savez(tmp_path / "floats.npz", columns=[stage.name.lower() for stage in EcuStage], rows=np.zeros((1, 14)))
    for name in ("vehicle.npz", "text.npz", "floats.npz", "none.npz"):
        with pytest.raises(StillwakeError, match=name):
            load(tmp_path / name, EcuStage)


def test_a_timed_controller_passes_everything_on_and_notes_before_and_after_a_failure_too():
    controller, now_ns = RecordingController(), partial(next, count(10))
    timed = TimedController(controller, now_ns)
    failing = TimedController(Answering(ControllerError("none")), now_ns, timed.times)
    times = [(timed.times.began_ns, timed.times.ended_ns)]
    window, plan, free, weights = np.arange(1, 5)[:, None]
    assert timed.control_step(window, plan, free, weights, 5.0, 6.0).plan.tolist() == [0.01]
    passed: list[Any] = [*controller.calls[0], *controller.settings[0]]
    assert passed == [1, 2, 3, 4, 5.0, 6.0]
    times.append((timed.times.began_ns, timed.times.ended_ns))
    timed.times.forget()
    times.append((timed.times.began_ns, timed.times.ended_ns))
    with pytest.raises(ControllerError):
        failing.control_step(window, plan, free)
    times.append((timed.times.began_ns, timed.times.ended_ns))
    assert times == [(0, 0), (10, 11), (0, 0), (12, 13)]
