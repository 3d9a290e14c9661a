"""The series as CSV, read by a program that knows nothing of it."""

import csv

import numpy as np

from can_bridge.wire.messages import Mode, Reason
from firmware_sim.runs.run_log import COLUMNS, WALL
from firmware_sim.runs.series_csv import COLUMN_UNITS, write_csv


def rows_of(path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def test_every_series_has_a_column_with_its_unit(shedding, tmp_path):
    log = shedding(modes={3: Mode.HOLD}, reasons={3: Reason.STREAM_LOST}, skipped=[4])
    log.series[WALL] = np.arange(640.0).reshape(160, 4)
    write_csv(tmp_path / "a.csv", log)
    rows = rows_of(tmp_path / "a.csv")
    assert len(rows) == 160
    assert tuple(COLUMN_UNITS) == COLUMNS
    assert list(rows[0])[:3] == ["t [t_c]", "Cd [1]", "Cl [1]"]
    assert list(rows[0])[-4:] == ["Cp_upper_39 [1]", "Cp_lower_39 [1]", "Cp_base_0 [1]", "Cp_base_9 [1]"]
    assert (rows[63]["mode [name]"], rows[63]["reason [name]"]) == ("HOLD", "STREAM_LOST")
    assert (rows[64]["step_ms [ms]"], rows[65]["step_ms [ms]"]) == ("", "2")
    assert float(rows[63]["t [t_c]"]) == 12.6
    assert float(rows[63]["action [U_inf W]"]) == 0.05
    assert float(rows[63]["Cp_base_0 [1]"]) == 63 * 4 + 2
    # A run without recorded sensors has no columns of them.
    write_csv(tmp_path / "b.csv", shedding())
    assert len(rows_of(tmp_path / "b.csv")[0]) == len(COLUMNS)
