"""The environment; and several wakes in one, each of them to the bit a single one, and so are their gradients."""

import copy
import os
import pickle
import warnings
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode

from contract import sensors
from contract.config.body import BodyConfig
from contract.config.plant import FlowConfig
from contract.errors import ConfigError, PlantError
from wake.env import TruckWakeEnv
from wake.truck.tape import Tape, no_weights
from wake.truck.truck_wake import TruckWake
from wake.vector_env import BatchTape, TruckWakeVectorEnv

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
    start = replace(wake.state(), flat=wake.solver.start().flat)
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
    inside = replace(coarse.start, substep=11)
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


SEEDS = [7, 3, 11]


@pytest.fixture(scope="module")
def several(settings) -> dict[str, Any]:
    return settings | {"max_phase_steps": 2, "episode_steps": 3}


@pytest.fixture(scope="module")
def vector(several):
    made = gymnasium.make_vec(
        "stillwake/TruckWake-v0", num_envs=3, vectorization_mode="vector_entry_point", threads=2, **several
    )
    yield made
    made.close()


def actions(count: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.09, 0.09, (count, 3, 1)).astype(np.float32)


def row(info: dict[str, Any], i: int) -> dict[str, Any]:
    """What `info` has of a wake, but for the hint at the gradients."""
    return {name: values[i] for name, values in info.items() if not name.startswith("_") and name != "gradients"}


def test_each_wake_is_to_the_bit_a_single_one_with_its_seed(vector, several):
    """In the mode of the next step: the step after an episode's last one resets, and has no reward."""
    singles = [TruckWakeEnv(**several) for _ in SEEDS]
    observation, info = vector.reset(seed=SEEDS)
    starts = [single.reset(seed=seed) for single, seed in zip(singles, SEEDS, strict=True)]
    for step, taken in enumerate([None, *actions(6)]):
        if taken is not None:
            observation, reward, terminated, truncated, info = vector.step(taken)
            found = [single.reset() if step == 4 else single.step(taken[i]) for i, single in enumerate(singles)]
            starts = [(one[0], one[-1]) for one in found]
            expected = [(0.0, False, False) if step == 4 else one[1:4] for one in found]
            assert list(zip(reward, terminated, truncated, strict=True)) == expected, step
        for i, (seen, facts) in enumerate(starts):
            np.testing.assert_array_equal(observation[i], seen)
            assert row(info, i) == {name: value for name, value in facts.items() if name != "gradients"}
    assert len({single.plant.t for single in singles}) > 1, "the seeds choose different phases"


def test_it_is_a_vector_environment_as_gymnasium_has_them(vector, several, monkeypatch):
    assert vector.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert vector.observation_space.shape == (3, 2) and vector.action_space.shape == (3, 1)
    first = vector.reset(seed=5)
    assert vector.observation_space.contains(first[0])
    assert data_equivalence(first, vector.reset(seed=[5, 6, 7])), "one seed stands for it and the next ones"
    vector.step(actions(1)[0])
    before = [wake.plant.t for wake in vector.unwrapped.wakes]
    vector.reset(seed=5, options={"reset_mask": np.array([False, True, False]), "phase_steps": 0})
    after = [wake.plant.t for wake in vector.unwrapped.wakes]
    assert (after[0], after[1], after[2]) == (before[0], vector.unwrapped.wakes[1]._phases[0].substep, before[2])
    same = TruckWakeVectorEnv(1, autoreset_mode="SameStep", **several | {"episode_steps": 1})
    with pytest.raises(gymnasium.error.ResetNeeded):
        same.step(np.zeros((1, 1), np.float32))
    same.reset(seed=1)
    *_, truncated, info = same.step(np.zeros((1, 1), np.float32))
    assert truncated.all() and info["final_info"]["t"][0] != info["t"][0]
    monkeypatch.delattr(os, "sched_getaffinity")  # as on macOS
    assert TruckWakeVectorEnv(1, **several).num_envs == 1
    with pytest.raises(ConfigError, match="num_envs = 0: must be at least 1"):
        TruckWakeVectorEnv(0, **several)


def test_an_error_of_one_wake_ends_the_step_and_a_reset_mends_it(vector):
    first, _ = vector.reset(seed=1)
    with pytest.raises(PlantError, match="action nan"):
        vector.step(np.array([[0.0], [np.nan], [0.0]], np.float32))
    copy.deepcopy(vector)
    np.testing.assert_array_equal(vector.reset(seed=1)[0], first)
    taken = actions(1)[0]
    expected, *_ = vector.step(taken)
    vector.reset(seed=1)
    np.testing.assert_array_equal(vector.step(taken)[0], expected)


def test_a_copy_goes_on_as_the_environment_does_and_leaves_it_alone(several):
    """Taken within an episode, after a picture; with the next episodes' random phases and their pictures."""
    vector = TruckWakeVectorEnv(2, render_mode="rgb_array", **several)
    vector.reset(seed=5)
    vector.step(actions(1)[0, :2])
    vector.render()
    stood = [wake.plant.flow.flat.copy() for wake in vector.wakes]
    ways = copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))
    copies = [way(vector) for way in ways]
    found = [([copied.step(taken[:2]) for taken in actions(4, seed=2)], copied.render()) for copied in copies]
    np.testing.assert_array_equal([wake.plant.flow.flat for wake in vector.wakes], stood)
    expected = [vector.step(taken[:2]) for taken in actions(4, seed=2)], vector.render()
    for seen in found:
        assert data_equivalence(seen, expected)


def test_the_gradients_of_a_batch_are_those_of_each_wakes_own_tape(vector):
    """Whose gradients are those of differences (`truck/test_tape.py`)."""
    vector.reset(seed=SEEDS)
    wakes = vector.unwrapped.wakes
    starts = [wake.plant.state() for wake in wakes]
    plan = 0.5 * actions(4)[:, :, 0].astype(float)
    drag = replace(no_weights(len(wakes[0].plant.layout)), Cd=1.0)
    batch = BatchTape(vector.unwrapped)
    for taken in plan:
        samples = batch.advance(taken)
    slopes = np.array([batch.back([drag] * 3) for _ in plan])
    for number, (wake, start) in enumerate(zip(wakes, starts, strict=True)):
        wake.plant.reset(start)
        alone = Tape(wake.plant)
        assert [alone.advance(action) for action in plan[:, number]][-1].Cd == samples[number].Cd
        assert slopes[:, number].tolist() == [alone.back(drag) for _ in plan]
