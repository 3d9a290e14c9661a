"""The table of stages: what is noted is read back; it neither grows nor loses the newest."""

import numpy as np
import pytest

from contract.errors import StillwakeError
from firmware_sim.ecu.real_time.stage_times import NOTHING, EcuStage, StageTimes, VehicleStage, load
from tests.each import each


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


def test_columns_bear_the_names_that_others_read_them_by(tmp_path):
    StageTimes(VehicleStage).save(tmp_path / "vehicle.npz")
    with np.load(tmp_path / "vehicle.npz") as file:
        assert file["columns"].tolist() == [
            "period",
            "scheduled",
            "sampled",
            "sent",
            "pressure_counter",
            "command_arrived",
            "echoed_counter",
            "actuated",
        ]
        assert file["rows"].shape == (0, 8)


@each("periods", [1, 3, 4, 7, 8, 9])
def test_a_full_table_keeps_the_newest(periods):
    table = StageTimes(VehicleStage, periods=4)
    for period in range(periods):
        table.begin()
        table.note(VehicleStage.PERIOD, period)
        if period == 0:
            table.note(VehicleStage.SAMPLED, 99)
    rows = table.rows()
    assert rows[:, 0].tolist() == list(range(periods))[-4:]
    # A row that is used again has nothing of its former period.
    assert rows[:, VehicleStage.SAMPLED].sum() == (99 if periods <= 4 else 0)


def test_another_file_is_refused(tmp_path):
    StageTimes(VehicleStage, periods=1).save(tmp_path / "vehicle.npz")
    (tmp_path / "text.npz").write_text("no archive")
    np.savez(tmp_path / "floats.npz", columns=[stage.name.lower() for stage in EcuStage], rows=np.zeros((1, 14)))
    for name in ("vehicle.npz", "text.npz", "floats.npz", "none.npz"):
        with pytest.raises(StillwakeError, match=name):
            load(tmp_path / name, EcuStage)
