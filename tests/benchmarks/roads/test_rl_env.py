"""The task for reinforcement learning: delay, window, reward and the episode's end, on a wake that only counts."""

from typing import cast

import numpy as np
import pytest

from benchmarks.roads.rl_env import RemembersWake, observed, reward
from contract.release import bundle as bundles
from contract.shipped import BUNDLE
from wake.env import TruckWakeEnv

MANIFEST = bundles.load(BUNDLE).manifest
LIMIT = MANIFEST.action_limit
LEDGER = {"Cd_net": 0.9, "jet_power": 0.05, "Cl": -0.3}


class Counting:
    """Cp is the number of the step at every sensor; truncated in the third."""

    def __init__(self) -> None:
        self.count, self.actions = 0, list[float]()

    def reset(self, *, seed=None, options=None):
        self.count = 0
        return np.zeros(len(MANIFEST.sensors), dtype=np.float32), {}

    def step(self, action):
        self.count += 1
        self.actions.append(float(action[0]))
        cp = np.full(len(MANIFEST.sensors), self.count, dtype=np.float32)
        return cp, 99.0, False, self.count >= 3, LEDGER


def task() -> tuple[RemembersWake, Counting]:
    wake = Counting()
    ticks = iter(range(100))
    return RemembersWake(cast(TruckWakeEnv, wake), MANIFEST, clock=lambda: float(next(ticks))), wake


def test_an_action_acts_in_the_step_after_and_is_cut_to_the_limit():
    env, wake = task()
    env.reset(seed=0)
    for asked in (0.5, -3.0, 1.0):
        env.step(np.array([asked], dtype=np.float32))
    assert wake.actions == pytest.approx([0.0, 0.5 * LIMIT, -LIMIT])


def test_what_is_seen_is_the_scaled_window_and_the_action_under_way():
    env, _ = task()
    env.reset(seed=0)
    env.step(np.array([0.5], dtype=np.float32))
    seen, paid, terminated, truncated, _ = env.step(np.array([-1.0], dtype=np.float32))
    rows = seen[:-1].reshape(MANIFEST.window, len(MANIFEST.sensors) + 1)
    mean, std = np.array(MANIFEST.scaling.pressure_mean), np.array(MANIFEST.scaling.pressure_std)
    assert rows[-1, :-1] * std + mean == pytest.approx(2.0, rel=1e-5)
    assert rows[-2, :-1] * std + mean == pytest.approx(1.0, rel=1e-5)
    assert rows[-1, -1] * MANIFEST.scaling.action_std == pytest.approx(0.5 * LIMIT, rel=1e-5)
    assert seen[-1] == -1.0 and not terminated and not truncated
    assert env.observation_space.contains(seen) and paid == reward(LEDGER)


def test_the_reward_is_what_is_saved_less_the_price_of_lift():
    assert reward(LEDGER) == pytest.approx(1.07 - 0.9 - 0.05 - 0.2 * 0.3)


def test_an_episode_ends_where_the_wake_s_does_and_its_time_is_counted():
    env, _ = task()
    env.reset()
    ended = [env.step(np.zeros(1, dtype=np.float32))[3] for _ in range(3)]
    assert ended == [False, False, True] and env.plant_seconds == 3.0
    again, _ = env.reset()
    assert again == pytest.approx(observed(MANIFEST, np.zeros((MANIFEST.window, len(MANIFEST.sensors) + 1)), 0.0))
