"""The table of stages: what is noted is read back; it neither grows nor loses the newest."""

from functools import partial
from itertools import count

import numpy as np
import pytest

from contract.controller.interface import ControllerError, ControlStep
from contract.errors import StillwakeError
from ecu.real_time.stage_times import NOTHING, EcuStage, StageTimes, TimedController, VehicleStage, load


def test_what_was_noted_is_read_back_and_the_rest_is_nothing(tmp_path):
    table = StageTimes(EcuStage, periods=3)
    table.begin()
    table.note(EcuStage.PERIOD, 5)
    table.note(EcuStage.SENT, 2**62)
    table.begin()
    table.note(EcuStage.PRESSURE_COUNTER, 0)
    table.save(tmp_path / "ecu.npz")
    first, second = load(tmp_path / "ecu.npz", EcuStage)
    assert first[EcuStage.SENT] == 2**62
    assert first.sum() == 5 + 2**62 + NOTHING
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


class Planning:
    def control_step(self, window, plan, free, weights=None, speed=1.0, limit=None) -> ControlStep:
        if not window.any():
            raise ControllerError("none")
        forces = np.array([window[0], free[0], weights[0], speed, limit])
        return ControlStep(plan=plan, forces=forces, terms=np.zeros(8), cost=0.0)


def test_a_timed_controller_passes_everything_on_and_notes_before_and_after_a_failure_too():
    timed = TimedController(Planning(), partial(next, count(10)))
    times = [(timed.times.began_ns, timed.times.ended_ns)]
    window, plan, free, weights = np.arange(1, 5)[:, None]
    answer = timed.control_step(window, plan, free, weights, 5.0, 6.0)
    assert (answer.plan.tolist(), answer.forces.tolist()) == ([2], [1, 3, 4, 5, 6])
    times.append((timed.times.began_ns, timed.times.ended_ns))
    timed.times.forget()
    times.append((timed.times.began_ns, timed.times.ended_ns))
    with pytest.raises(ControllerError):
        timed.control_step(*(np.zeros(1),) * 3)
    times.append((timed.times.began_ns, timed.times.ended_ns))
    assert times == [(0, 0), (10, 11), (0, 0), (12, 13)]
