import csv
import runpy
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from contract.config.body import BodyConfig, layout_of
from contract.config.loading import load_config
from contract.recording.dataset import Dataset, read, write
from tests.contract.recording.random_episodes import episode
from wake.truck.truck_wake import TruckWake

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.mark.slow
def test_naive_feedback_compares_with_and_without(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["naive_feedback.py", "3"])
    runpy.run_path(str(EXAMPLES / "naive_feedback.py"), run_name="__main__")
    drag = [float(line.split()[3].rstrip(",")) for line in capsys.readouterr().out.splitlines()]
    assert len(drag) == 3
    assert len(set(drag)) > 1 and all(0.8 < value < 1.2 for value in drag)


@pytest.mark.slow
def test_the_linear_feedback_is_stable_on_its_model_and_acts_in_the_environment(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["linear_feedback.py", "3"])
    made = runpy.run_path(str(EXAMPLES / "linear_feedback.py"), run_name="__main__")
    assert 0.8 < float(capsys.readouterr().out.split()[1]) < 1.2
    model, gain, size = made["model"], made["gain"], 3 * made["MEMORY"]
    # A history, with the action that the gain decides, becomes the next one.
    closed = np.vstack([np.eye(size - 3, size, 3), model[:2]]) @ np.vstack([np.eye(size - 1), gain])
    assert np.abs(np.linalg.eigvals(closed)).max() < 1.0
    # The wake's own instability, without action: 0.1 e-foldings in t_c, of which a control step has 0.2.
    free = np.abs(np.linalg.eigvals(np.vstack([np.eye(size - 3, size, 3), model[:2]])[:, :-1])).max()
    assert 0.0 < np.log(free) / 0.2 < 0.3


def test_a_recording_as_csv_is_what_another_solver_would_give(tmp_path, capsys):
    layout, one = layout_of(BodyConfig()), episode("one", 6)
    write(tmp_path / "truck.h5", Dataset(episodes=(one,)))
    as_csv = runpy.run_path(str(EXAMPLES / "square_cylinder" / "as_csv.py"))
    as_csv["main"](tmp_path / "truck.h5", tmp_path / "csv")
    sensors = list(csv.DictReader((tmp_path / "csv" / "sensors.csv").open(encoding="utf-8")))
    assert [row["name"] for row in sensors] == list(layout.names)
    assert [[float(row["x"]), float(row["y"])] for row in sensors] == layout.positions.tolist()
    assert [k for k, row in enumerate(sensors) if row["base"] == "1"] == layout.base.tolist()
    rows = list(csv.DictReader((tmp_path / "csv" / "train_one.csv").open(encoding="utf-8")))
    stored = read(tmp_path / "truck.h5").episodes[0].series
    for name in ("t", "action", "Cd", "Cl"):
        assert [float(row[name]) for row in rows] == stored[name].tolist()
    assert [float(row["base_3"]) for row in rows] == stored["Cp"][:, layout.names.index("base_3")].tolist()
    few = replace(layout, names=layout.names[:4], positions=layout.positions[:4], base=layout.base[:0], mirror=None)
    own = replace(one, series={**one.series, "Cp": one.series["Cp"][:, :4]})
    write(tmp_path / "own.h5", Dataset(episodes=(own,), layout=few))
    as_csv["main"](tmp_path / "own.h5", tmp_path / "own")
    assert (tmp_path / "own" / "sensors.csv").read_text().count("\n") == 5


def test_the_squares_settings_are_a_square_whose_time_step_holds():
    config = load_config(EXAMPLES / "square_cylinder" / "square.toml", [])
    assert (config.body.length, config.body.leading_edge_radius) == (1.0, 0.0)
    assert len(layout_of(config.body)) == 50
    TruckWake(config.flow, body=config.body)
