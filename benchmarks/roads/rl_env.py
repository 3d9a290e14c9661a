"""The wake as a task for reinforcement learning: what the ECU remembers, its delay, and a reward from the drag ledger.

Reward of a control period, with the ledger at its end: 1.07 - Cd_net - jet_power - 0.2 |Cl|. The first three are what a
vehicle pays, in units of drag, less what it pays without control; the last keeps the wake from being bent aside.
"""

import time
from collections.abc import Callable, Mapping
from typing import Any, Final

import gymnasium
import numpy as np

from contract.arrays import Array
from contract.release.manifest import Manifest
from wake.env import Observation, TruckWakeEnv

UNCONTROLLED: Final = 1.07
"""Cd_net of the wake without control."""
LIFT_PRICE: Final = 0.2


def reward(ledger: Mapping[str, float]) -> float:
    """The reward of a control period, by the ledger at its end."""
    return UNCONTROLLED - ledger["Cd_net"] - ledger["jet_power"] - LIFT_PRICE * abs(ledger["Cl"])


def observed(manifest: Manifest, window: Array, committed: float) -> Observation:
    """What a policy sees: the window in the release's scaling, and the action under way, (L (S+1) + 1,)."""
    scaling = manifest.scaling
    scaled = (window - np.array(scaling.window_mean)) / np.array(scaling.window_std)
    return np.append(scaled.ravel(), committed / manifest.action_limit).astype(np.float32)


class RemembersWake(gymnasium.Env[Observation, Observation]):
    """`TruckWakeEnv` behind the ECU's window and delay; actions are shares of the limit, in [-1, 1].

    What is asked for in a step acts in the next one. A window begins with its first row throughout.

    Args:
        wake: observing the manifest's sensors.
        clock: of the time that the plant takes.

    Attributes:
        plant_seconds: that time so far.
    """

    def __init__(self, wake: TruckWakeEnv, manifest: Manifest, clock: Callable[[], float] = time.process_time) -> None:
        self._wake, self._manifest, self._clock = wake, manifest, clock
        self._window = np.zeros((manifest.window, len(manifest.sensors) + 1))
        self._committed, self.plant_seconds = 0.0, 0.0
        size = self._window.size + 1
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, shape=(size,), dtype=np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, shape=(1,), dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """At a random phase of the shedding cycle."""
        super().reset(seed=seed)
        cp, info = self._wake.reset(seed=seed, options=options)
        self._window[:] = np.append(cp, 0.0)
        self._committed = 0.0
        return observed(self._manifest, self._window, 0.0), info

    def step(self, action: Observation) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """A control period with the action asked for before this one."""
        acting = self._committed
        before = self._clock()
        cp, _, terminated, truncated, info = self._wake.step(np.array([acting]))
        self.plant_seconds += self._clock() - before
        self._window[:-1] = self._window[1:]
        self._window[-1] = np.append(cp, acting)
        self._committed = float(np.clip(action[0], -1.0, 1.0)) * self._manifest.action_limit
        seen = observed(self._manifest, self._window, self._committed)
        return seen, reward(info), terminated, truncated, info
