import dataclasses
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from contract import sensors
from contract.config.body import BodyConfig
from contract.config.plant import FlowConfig
from contract.errors import ConfigError, PlantError
from wake.env import TruckWakeEnv
from wake.truck.truck_wake import TruckWake

pytestmark = pytest.mark.slow  # seconds of flow

WATCHED = ("base_0", "upper_39")


@pytest.fixture(scope="module")
def settings(coarse) -> dict[str, Any]:
    return {"sensor_names": WATCHED, "config": coarse.flow, "start": coarse.start, "max_phase_steps": 3}


@pytest.fixture(scope="module")
def env(settings) -> TruckWakeEnv:
    return TruckWakeEnv(episode_steps=3, render_mode="rgb_array", **settings)


def action(value: float) -> np.ndarray:
    return np.array([value], dtype=np.float32)


def test_gymnasiums_own_checker_is_content(settings):
    made = gymnasium.make("stillwake/TruckWake-v0", **settings)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(made.unwrapped)
    # Objects of other tests that are collected meanwhile may warn of open files, with another category.
    said = [str(warning.message) for warning in caught if issubclass(warning.category, UserWarning)]
    # It recommends finite bounds; a wall pressure has none.
    assert said and all("infinity. This is probably too" in each for each in said)


def test_one_step_is_one_control_period_of_the_plant(env, coarse):
    observation, info = env.reset(options={"phase_steps": 0})
    assert observation.shape == (2,) and observation.dtype == np.float32
    first = env.render()
    with coarse.plant() as wake:
        for value in (0.05, -0.02):
            observation, reward, terminated, truncated, info = env.step(action(value))
            sample = wake.advance(float(np.float32(value)))
            assert (reward, terminated, truncated) == (-sample.Cd, False, False)
            watched = [sensors.NAMES.index(name) for name in WATCHED]
            assert np.array_equal(observation, sample.Cp[watched].astype(np.float32))
            for name in ("t", "Cd", "Cl", "Cd_slot", "Cd_momentum", "jet_power", "Uy_probe", "action"):
                assert info[name] == getattr(sample, name), name
            assert info["Cd_net"] == pytest.approx(info["Cd"] + info["Cd_slot"] + info["Cd_momentum"])
    second = env.render()
    assert first.shape == second.shape == (341, 1100, 3) and first.dtype == np.uint8
    assert not np.array_equal(first, second), "frames follow the flow"


def test_what_lies_beyond_the_bound_is_clipped_and_counted(env):
    _, info = env.reset(seed=1)
    seen = [(info["clipped"], info["clipped_count"], info["action"])]
    for step, value in enumerate((0.2, 0.0, -3.0, float(np.float32(0.075)))):
        *_, terminated, truncated, info = env.step(action(value))
        assert (terminated, truncated) == (False, step >= 2), "an episode has three steps"
        seen.append((info["clipped"], info["clipped_count"], info["action"]))
    assert seen == [(False, 0, 0.0), (True, 1, 0.075), (False, 1, 0.0), (True, 2, -0.075), (False, 2, 0.075)]
    assert env.reset(seed=1)[1]["clipped_count"] == 0


def test_seeds_choose_the_phase_and_phases_are_the_uncontrolled_wake(env, coarse):
    starts = [env.reset(seed=seed) for seed in range(12)]
    wake = TruckWake(coarse.flow)
    samples = [wake.reset(coarse.start), *(wake.advance(0.0) for _ in range(3))]
    seen = {round(info["t"] / 0.2) for _, info in starts}
    assert len(seen) > 1 and seen <= {0, 1, 2, 3}
    for _, info in starts:
        sample = samples[round(info["t"] / 0.2)]
        assert (info["t"], info["Cd"], info["action"]) == (sample.t, sample.Cd, 0.0)
    # Without a seed the generator goes on: not every episode begins alike.
    assert len({env.reset()[1]["t"] for _ in range(12)}) > 1
    sample = wake.advance(0.06)
    _, info = env.reset(options={"start": wake.state()})
    assert (info["Cd"], info["action"]) == (sample.Cd, 0.06)


def test_another_body_shows_its_own_sensors():
    body = BodyConfig(length=1.0, leading_edge_radius=0.0, sensors_per_side=3, sensors_on_base=2)
    config = FlowConfig(reynolds=150.0)
    wake = TruckWake(config, body=body)
    # Uniform flow around a square, projected: what `develop` begins from.
    start = dataclasses.replace(wake.state(), flat=wake.solver.start().flat)
    env = TruckWakeEnv(config=config, body=body, start=start, max_phase_steps=0)
    assert env.reset(seed=1)[0].shape == env.observation_space.shape == (8,)


def test_what_does_not_fit_is_refused_by_its_value(env, coarse):
    for value, message in (
        (action(np.nan), "action nan: must be finite"),
        (np.zeros(2, dtype=np.float32), r"shape \(2,\): must be one value"),
    ):
        env.reset(seed=1)
        with pytest.raises(PlantError, match=message):
            env.step(value)
    inside = dataclasses.replace(coarse.start, substep=11)
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"phase": 1}, r"reset options \['phase'\]: must be one of 'start' and 'phase_steps'"),
        ({"phase_steps": 4}, "phase_steps = 4: must be a whole number from 0 to max_phase_steps = 3"),
        ({"start": "file.npz"}, "start is a str: must be a wake.truck.state.State"),
        ({"start": inside}, "11 substeps inside a control period"),
    ]
    for given, message in wrong:
        with pytest.raises((ConfigError, PlantError), match=message):
            env.reset(options=given)
    wrong = [
        ({"sensor_names": "upper_39"}, r"= 'upper_39': must be a sequence of names, such as \['upper_39'\]"),
        ({"render_mode": "human"}, "render_mode = 'human'"),
    ]
    for given, message in wrong:
        with pytest.raises(ConfigError, match=message):
            TruckWakeEnv(**given)
    fresh = TruckWakeEnv(render_mode="rgb_array")
    for use in (lambda: fresh.step(action(0.0)), fresh.render):
        with pytest.raises(gymnasium.error.ResetNeeded):
            use()
