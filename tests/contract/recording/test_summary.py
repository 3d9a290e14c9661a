"""The settings that follow from a data set whose signals are known."""

import tomllib

import numpy as np

from contract.recording.dataset import Dataset, Episode
from contract.recording.episode import PlantFacts
from contract.recording.summary import fitting_settings
from contract.sensor_layout import SensorLayout

PERIOD = 0.25
LAYOUT = SensorLayout.of(("a", "b"), np.eye(2), symmetric=False)


def wave(name: str, steps: int, cycle: float, amplitude: float) -> Episode:
    """Cl of one frequency, 2 in amplitude, about 0.5; action of the same with that amplitude."""
    t = PERIOD * np.arange(steps)
    phase = 2 * np.pi * np.arange(steps) / cycle
    series = {"t": t, "action": amplitude * np.sin(phase), "Cd": np.full(steps, 1.25), "Cl": 0.5 + 2 * np.cos(phase)}
    return Episode(
        name=name, role="train", series={**series, "Cp": np.zeros((steps, 2))}, initial_action=0.0, provenance={}
    )


def data(*episodes: Episode, **facts: float) -> Dataset:
    return Dataset(episodes=episodes, layout=LAYOUT, facts=PlantFacts(control_period=PERIOD, **facts))


def test_settings_follow_from_the_data():
    short, calm, forced = wave("short", 60, 9.0, 0.0), wave("calm", 400, 20.0, 0.0), wave("forced", 500, 30.0, 0.1)
    text = fitting_settings(data(short, calm, forced, action_limit=0.1, reynolds=90.0))
    assert "# mean Cd, uncontrolled, 400 steps of calm" in text
    assert tomllib.loads(text) == {
        "flow": {"control_period": PERIOD, "action_limit": 0.1, "reynolds": 90.0},
        "mpc": {"drag_reference": 1.25, "horizon": 20},
        "model": {"window": 24},
        "train": {"sensors": 2},
    }
    text = fitting_settings(data(wave("forced", 300, 20.0, 0.1), wave("moment", 24, 20.0, 0.0), action_limit=0.1))
    assert "all episodes: none is uncontrolled for 25 steps" in text
    assert "horizon" not in tomllib.loads(text)["mpc"]
