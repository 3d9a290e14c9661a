"""The wake as a Gymnasium environment, registered as `stillwake/TruckWake-v0`."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from contract import sensors
from contract.config import FlowConfig
from wake.pictures import vorticity_image
from wake.truck_wake import Sample, TruckWake, developed_state

Observation = npt.NDArray[np.float32]


class TruckWakeEnv(gymnasium.Env[Observation, npt.NDArray[np.float32]]):
    """One step is one control period of 0.2 t_c.

    Observation: Cp at the named sensors, float32. Action: jet flow rate in U_inf W, shape (1,), within +-0.075; what
    lies beyond is clipped and `info["clipped"]` says so. Reward: -Cd of the wall. `info` carries the drag ledger of
    `wake.truck_wake.Sample`. An episode never terminates; it is truncated after `episode_steps`.

    Args:
        sensor_names: the observed sensors; all 90 by default.
        episode_steps: control steps until truncation.
        config: flow settings.
        max_lead_steps: a seeded reset starts between 0 and so many uncontrolled steps after the shipped developed
            state, so that episodes begin at different phases of the shedding cycle (25 steps).
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  (Gymnasium's own convention)

    def __init__(
        self,
        sensor_names: Sequence[str] = sensors.NAMES,
        episode_steps: int = 500,
        config: FlowConfig | None = None,
        max_lead_steps: int = 25,
        render_mode: str | None = None,
    ) -> None:
        self._wake = TruckWake(config)
        self._columns = sensors.indices(sensor_names)
        self._episode_steps = episode_steps
        self._max_lead_steps = max_lead_steps
        self._step_count = 0
        self.render_mode = render_mode
        limit = self._wake.config.action_limit
        self.action_space = gymnasium.spaces.Box(-limit, limit, shape=(1,), dtype=np.float32)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, shape=(len(sensor_names),), dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        super().reset(seed=seed)
        del options
        sample = self._wake.reset(developed_state())
        for _ in range(int(self.np_random.integers(self._max_lead_steps + 1))):
            sample = self._wake.advance(0.0)
        self._step_count = 0
        return self._observe(sample), _ledger(sample, clipped=False)

    def step(self, action: npt.NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Ramp the jets to `action` over one control period; raises PlantError for a non-finite action."""
        wanted = float(np.asarray(action, dtype=np.float64).reshape(-1)[0])
        limit = self._wake.config.action_limit
        # float32 rounds the bound itself up by an ulp; that is not a clipped action.
        clipped = bool(abs(wanted) > np.float32(limit))
        sample = self._wake.advance(float(np.clip(wanted, -limit, limit)))
        self._step_count += 1
        truncated = self._step_count >= self._episode_steps
        return self._observe(sample), -sample.Cd, False, truncated, _ledger(sample, clipped)

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Vorticity as an rgb image, (height, width, 3)."""
        if self.render_mode is None:
            return None
        return vorticity_image(self._wake)

    def _observe(self, sample: Sample) -> Observation:
        return sample.Cp[self._columns].astype(np.float32)


def _ledger(sample: Sample, clipped: bool) -> dict[str, Any]:
    slot = ("Cd_slot", "Cd_slot_pressure", "Cd_slot_viscous")
    fields = ("t", "Cd", "Cl", *slot, "Cd_momentum", "Cd_net", "jet_power", "Uy_probe", "action")
    return {name: getattr(sample, name) for name in fields} | {"clipped": clipped}


# Gymnasium 1.0 dropped entry points: importing this module is what registers.
gymnasium.register(id="stillwake/TruckWake-v0", entry_point="wake.env:TruckWakeEnv")
