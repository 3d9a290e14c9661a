"""What training or export would stumble over is found beforehand, each thing by itself and all at once."""

import tomllib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from contract.arrays import Array
from contract.config.learning import ModelConfig, TrainConfig
from contract.config.operating_point import OperatingPoint
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.errors import DatasetError
from contract.recording import dataset, needs
from contract.recording.dataset import Dataset, Episode, Role
from contract.recording.episode import PlantFacts
from contract.recording.findings import asymmetry, findings, left_out, refuse_unfit, trainable
from contract.recording.summary import fitting_settings
from contract.sensor_layout import SensorLayout
from contract.shipped import RECORDING
from export.to_c.int8_arrays import INT8_LANES
from tests import foreign_plant
from tests.foreign_plant import BASE, LIMIT, NAMES, PERIOD, POSITIONS

LAYOUT = SensorLayout.of(NAMES, np.array(POSITIONS), base=[NAMES.index(name) for name in BASE], symmetric=False)
FACTS, T = PlantFacts(control_period=PERIOD, action_limit=LIMIT), PERIOD * np.arange(120)
CONFIG = Config(
    flow=FlowConfig(control_period=PERIOD, action_limit=LIMIT),
    model=ModelConfig(window=12),
    train=TrainConfig(segment=8, shap_background=10, shap_explained=30),
)


def episode(name: str, role: Role, steps: int, *, forced: bool = True, **changes: Any) -> Episode:
    values = foreign_plant.series(steps, steps, forced=forced) | changes.pop("series", {})
    fields = {"initial_action": 0.0, "provenance": {}, **changes}
    return Episode(name=name, role=role, series=values, **fields)


@pytest.fixture(scope="module")
def sound() -> Dataset:
    calm = episode("calm", "train", 80, forced=False)
    episodes = (episode("sweep", "train", 120), calm, episode("held out", "test", 90))
    return Dataset(episodes=episodes, layout=LAYOUT, facts=FACTS)


def texts(data: Dataset, config: Config = CONFIG, stops: str | None = "training") -> list[str]:
    return [item.text for item in findings(data, config) if item.stops == stops]


def with_first(data: Dataset, **changes: Any) -> Dataset:
    first, *others = data.episodes
    return replace(data, episodes=(replace(first, series={**first.series, **changes}), *others))


def with_each(data: Dataset, change: Callable[[dict[str, Array]], dict[str, Array]]) -> Dataset:
    changed = (replace(one, series={**one.series, **change(dict(one.series))}) for one in data.episodes)
    return replace(data, episodes=tuple(changed))


@pytest.mark.slow
def test_a_sound_data_set_has_only_notes(sound):
    notes = findings(sound, CONFIG)
    assert all(note.stops is None for note in notes)
    mirror, window = (note.text for note in notes)
    assert "no mirror images" in mirror
    assert "model.window = 12" in window and "multiples of 8; the nearest is 16" in window
    assert needs.WINDOW_STEP == INT8_LANES
    refuse_unfit(notes, "a.h5")
    # The shipped recording is sound; half a deviation off at one of two mirror images, it is no symmetric flow's.
    shipped = dataset.read(RECORDING)
    assert findings(shipped, Config()) == ()
    one = replace(shipped, episodes=shipped.episodes[:1])
    (skew,) = asymmetry(with_first(one, Cp=one.episodes[0].series["Cp"] + 5.0 * (np.arange(90) == 89)))
    assert "base_0 and base_9 are mirror images, but their mean Cp is" in skew and "--asymmetric" in skew


def test_times_and_actions_are_checked(sound):
    action = sound.episodes[0].series["action"]
    for series, message in (
        ({"t": T[::-1]}, "episode sweep: t does not rise from step 0 to 1: 35.7, 35.4"),
        ({"t": np.where(np.arange(120) > 50, T + 0.1, T)}, "t rises by 0.4 from step 50 to 51"),
        ({"action": np.linspace(0, 2.0, 120)}, "episode sweep: action is 2 at step 119, beyond the limit of 0.2 (10"),
        ({"Cd": np.ones(120)}, None),  # the other training episode has a Cd that changes
        ({"t": np.round(T, 2), "action": np.round(action, 3)}, None),  # rounded, as in text files
    ):
        found = texts(with_first(sound, **series))
        assert found == [] if message is None else len(found) == 1 and message in found[0]
    # An episode of another plant than the first is named.
    flow = {"control_period": PERIOD, "action_limit": 0.1}
    other = episode("odd", "train", 80, forced=False, provenance={"flow": flow})
    (text,) = texts(replace(sound, episodes=(*sound.episodes, other)))
    assert text == "episode odd: its provenance has flow.action_limit = 0.1, the data set has 0.2"


def test_a_constant_signal_is_named(sound):
    stuck = with_each(sound, lambda d: {"Cp": np.where(np.arange(7) == 3, 0.25, d["Cp"])})
    assert [text[:44] for text in texts(stuck)] == ["sensor lid-left is constant at 0.25 in all t"]


def test_what_is_missing_for_training_is_named(sound):
    for role, index in (("train", slice(2, 3)), ("test", slice(0, 2))):
        (text, *_) = texts(replace(sound, episodes=sound.episodes[index]))
        assert text.startswith(f"dataset has no episode with role '{role}'") and f"with {role}=FILE; a" in text
    # Too few windows or sensors for the selection are named.
    shap = replace(CONFIG, train=replace(CONFIG.train, shap_explained=5000))
    # 120 - 11 and 80 - 11 windows, without mirror images.
    assert texts(sound, shap)[0].startswith("training episodes hold 178 windows, too few for 5000 samples")
    many = replace(CONFIG, train=replace(CONFIG.train, sensors=8))
    assert texts(sound, many) == ["train.sensors = 8: must be from 1 to 7, the number of sensors"]
    assert not [item for item in findings(sound, many, choosing=False) if item.stops]
    # All of it is reported at once.
    bad = with_first(sound, t=2 * T, action=np.linspace(0, 2.0, 120))
    found = findings(bad, replace(CONFIG, flow=FlowConfig()))
    assert len([item for item in found if item.stops == "training"]) == 4
    with pytest.raises(DatasetError, match="and 3 more"):
        refuse_unfit(found, "a.h5")


def test_a_short_training_episode_is_left_out_by_name_and_only_all_of_them_stop_training(sound):
    need = needs.fitting_need(CONFIG).steps
    short = episode("blink", "train", need - 1)
    with_short = replace(sound, episodes=(*sound.episodes, short))
    assert [item.name for item in trainable(with_short, CONFIG)] == ["sweep", "calm"]
    (line,) = left_out(with_short, CONFIG)
    assert line.startswith(f"episode blink has {need - 1} steps") and f"need {need}; it is left out" in line
    assert line in texts(with_short, stops=None)
    assert texts(with_short) == []
    only = replace(sound, episodes=(short, sound.episodes[2]))
    assert any("blink has" in text for text in texts(only))


def test_what_export_needs_is_told_before_training(sound):
    short = with_each(sound, lambda d: {name: values[:60] for name, values in d.items()})
    assert texts(short) == []
    gate, calibration = texts(short, stops="export")
    assert gate.startswith("test episodes are too short") and "need 61" in gate
    assert calibration.startswith("training episodes are too short")
    rig = replace(CONFIG, operating_point=OperatingPoint(width=0.1, speed=20.0, density=1.2))
    (text,) = texts(sound, rig, stops="export")
    assert text.startswith("ecu.compute_time_ms = 8: must be within the control period, which is 1.5 ms")


def forced_by(*waves: Callable[[Array], Array], steps: int = 500) -> Dataset:
    """A data set whose training episodes are forced by these waves of t."""
    t = PERIOD * np.arange(steps, dtype=np.float64)
    training = [
        episode(f"wave {i}", "train", steps, series={"action": 0.5 * LIMIT * wave(t)}) for i, wave in enumerate(waves)
    ]
    return Dataset(episodes=(*training, episode("held out", "test", 90)), layout=LAYOUT, facts=FACTS)


def sine(frequency: float) -> Callable[[Array], Array]:
    return lambda t: np.sin(2.0 * np.pi * frequency * t)


def test_forcing_at_one_frequency_is_noted():
    for name, waves, steps, noted in (
        ("envelope", [lambda t: sine(0.2)(t) * (1.0 + 0.45 * sine(0.005)(t))], 500, True),
        ("two alike", [sine(0.2), sine(0.205)], 500, True),
        ("two", [sine(0.15), sine(0.25)], 500, False),
        ("too short to tell frequencies apart", [sine(0.2)], 120, False),
    ):
        found = texts(forced_by(*waves, steps=steps), stops=None)
        assert any("are of one frequency, 0.2 U_inf / W" in text for text in found) == noted, name


def test_slips_of_units_are_noted(sound):
    """Places in millimetres, a limit in percent, times in seconds (W / U_inf = 5 ms): each note names the remedy."""
    places = replace(sound.layout, positions=100.0 * sound.layout.positions)
    assert any("divide lengths by the width" in text for text in texts(replace(sound, layout=places), stops=None))
    percent = replace(sound, facts=replace(sound.facts, action_limit=20.0))
    assert any("flow.action_limit should be about" in text for text in texts(percent, stops=None))
    period = 0.005 * sound.facts.control_period
    seconds = replace(
        with_each(sound, lambda d: {"t": 0.005 * d["t"]}), facts=replace(sound.facts, control_period=period)
    )
    config = replace(CONFIG, flow=replace(CONFIG.flow, control_period=period))
    assert any("divide seconds by W / U_inf" in text for text in texts(seconds, config, stops=None))


def wave(name: str, steps: int, cycle: float, amplitude: float) -> Episode:
    """Cl of one frequency, 2 in amplitude, about 0.5; action of the same with that amplitude."""
    phase = 2 * np.pi * np.arange(steps) / cycle
    series = {"t": 0.25 * np.arange(steps), "action": amplitude * np.sin(phase), "Cd": np.full(steps, 1.25)}
    series |= {"Cl": 0.5 + 2 * np.cos(phase), "Cp": np.zeros((steps, 2))}
    return Episode(name=name, role="train", series=series, initial_action=0.0, provenance={})


def data(*episodes: Episode, **facts: float) -> Dataset:
    layout = SensorLayout.of(("a", "b"), np.eye(2), symmetric=False)
    return Dataset(episodes=episodes, layout=layout, facts=PlantFacts(control_period=0.25, **facts))


def test_settings_follow_from_the_data():
    short, calm, forced = wave("short", 60, 9.0, 0.0), wave("calm", 400, 20.0, 0.0), wave("forced", 500, 30.0, 0.1)
    text = fitting_settings(data(short, calm, forced, action_limit=0.1, reynolds=90.0))
    assert "# mean Cd, uncontrolled, 400 steps of calm" in text
    assert tomllib.loads(text) == {
        "flow": {"control_period": 0.25, "action_limit": 0.1, "reynolds": 90.0},
        "mpc": {"drag_reference": 1.25, "horizon": 20},
        "model": {"window": 24},
        "train": {"sensors": 2},
    }
    text = fitting_settings(data(wave("forced", 300, 20.0, 0.1), wave("moment", 24, 20.0, 0.0), action_limit=0.1))
    assert "all episodes: none is uncontrolled for 25 steps" in text
    assert "horizon" not in tomllib.loads(text)["mpc"]
