"""Several wakes in one environment: each is to the bit a single one, and so are their gradients."""

import copy
import os
import pickle
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode

from contract.errors import ConfigError, PlantError
from wake.env import TruckWakeEnv
from wake.truck.tape import Tape, no_weights
from wake.vector_env import BatchTape, TruckWakeVectorEnv

pytestmark = pytest.mark.slow  # seconds of flow

WATCHED = ("base_0", "upper_39")
SEEDS = [7, 3, 11]


@pytest.fixture(scope="module")
def settings(coarse) -> dict[str, Any]:
    return dict(sensor_names=WATCHED, config=coarse.flow, start=coarse.start, max_phase_steps=2, episode_steps=3)


@pytest.fixture(scope="module")
def env(settings):
    made = gymnasium.make_vec(
        "stillwake/TruckWake-v0", num_envs=3, vectorization_mode="vector_entry_point", threads=2, **settings
    )
    yield made
    made.close()


def actions(count: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.09, 0.09, (count, 3, 1)).astype(np.float32)


def row(info: dict[str, Any], i: int) -> dict[str, Any]:
    """What `info` has of a wake, but for the hint at the gradients."""
    return {name: values[i] for name, values in info.items() if not name.startswith("_") and name != "gradients"}


def test_each_wake_is_to_the_bit_a_single_one_with_its_seed(env, settings):
    """In the mode of the next step: the step after an episode's last one resets, and has no reward."""
    singles = [TruckWakeEnv(**settings) for _ in SEEDS]
    observation, info = env.reset(seed=SEEDS)
    starts = [single.reset(seed=seed) for single, seed in zip(singles, SEEDS, strict=True)]
    for step, taken in enumerate([None, *actions(6)]):
        if taken is not None:
            observation, reward, terminated, truncated, info = env.step(taken)
            found = [single.reset() if step == 4 else single.step(taken[i]) for i, single in enumerate(singles)]
            starts = [(one[0], one[-1]) for one in found]
            expected = [(0.0, False, False) if step == 4 else one[1:4] for one in found]
            assert list(zip(reward, terminated, truncated, strict=True)) == expected, step
        for i, (seen, facts) in enumerate(starts):
            np.testing.assert_array_equal(observation[i], seen)
            assert row(info, i) == {name: value for name, value in facts.items() if name != "gradients"}
    assert len({single.plant.t for single in singles}) > 1, "the seeds choose different phases"


def test_it_is_a_vector_environment_as_gymnasium_has_them(env, settings, monkeypatch):
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert env.observation_space.shape == (3, 2) and env.action_space.shape == (3, 1)
    first = env.reset(seed=5)
    assert env.observation_space.contains(first[0])
    assert data_equivalence(first, env.reset(seed=[5, 6, 7])), "one seed stands for it and the next ones"
    env.step(actions(1)[0])
    before = [wake.plant.t for wake in env.unwrapped.wakes]
    env.reset(seed=5, options={"reset_mask": np.array([False, True, False]), "phase_steps": 0})
    after = [wake.plant.t for wake in env.unwrapped.wakes]
    assert (after[0], after[1], after[2]) == (before[0], env.unwrapped.wakes[1]._phases[0].substep, before[2])
    same = TruckWakeVectorEnv(1, autoreset_mode="SameStep", **settings | {"episode_steps": 1})
    with pytest.raises(gymnasium.error.ResetNeeded):
        same.step(np.zeros((1, 1), np.float32))
    same.reset(seed=1)
    *_, truncated, info = same.step(np.zeros((1, 1), np.float32))
    assert truncated.all() and info["final_info"]["t"][0] != info["t"][0]
    monkeypatch.delattr(os, "sched_getaffinity")  # as on macOS
    assert TruckWakeVectorEnv(1, **settings).num_envs == 1
    with pytest.raises(ConfigError, match="num_envs = 0: must be at least 1"):
        TruckWakeVectorEnv(0, **settings)


def test_an_error_of_one_wake_ends_the_step_and_a_reset_mends_it(env):
    first, _ = env.reset(seed=1)
    with pytest.raises(PlantError, match="action nan"):
        env.step(np.array([[0.0], [np.nan], [0.0]], np.float32))
    copy.deepcopy(env)
    np.testing.assert_array_equal(env.reset(seed=1)[0], first)
    taken = actions(1)[0]
    expected, *_ = env.step(taken)
    env.reset(seed=1)
    np.testing.assert_array_equal(env.step(taken)[0], expected)


def test_a_copy_goes_on_as_the_environment_does_and_leaves_it_alone(settings):
    """Taken within an episode, after a picture; with the next episodes' random phases and their pictures."""
    env = TruckWakeVectorEnv(2, render_mode="rgb_array", **settings)
    env.reset(seed=5)
    env.step(actions(1)[0, :2])
    env.render()
    stood = [wake.plant.flow.flat.copy() for wake in env.wakes]
    ways = copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))
    copies = [way(env) for way in ways]
    found = [([copied.step(taken[:2]) for taken in actions(4, seed=2)], copied.render()) for copied in copies]
    np.testing.assert_array_equal([wake.plant.flow.flat for wake in env.wakes], stood)
    expected = [env.step(taken[:2]) for taken in actions(4, seed=2)], env.render()
    for seen in found:
        assert data_equivalence(seen, expected)


def test_the_gradients_of_a_batch_are_those_of_each_wakes_own_tape(env):
    """Whose gradients are those of differences (`truck/test_tape.py`)."""
    env.reset(seed=SEEDS)
    wakes = env.unwrapped.wakes
    starts = [wake.plant.state() for wake in wakes]
    plan = 0.5 * actions(4)[:, :, 0].astype(float)
    drag = replace(no_weights(len(wakes[0].plant.layout)), Cd=1.0)
    batch = BatchTape(env.unwrapped)
    for taken in plan:
        samples = batch.advance(taken)
    slopes = np.array([batch.back([drag] * 3) for _ in plan])
    for number, (wake, start) in enumerate(zip(wakes, starts, strict=True)):
        wake.plant.reset(start)
        alone = Tape(wake.plant)
        assert [alone.advance(action) for action in plan[:, number]][-1].Cd == samples[number].Cd
        assert slopes[:, number].tolist() == [alone.back(drag) for _ in plan]
