"""The wake as a Gymnasium environment, registered as `stillwake/TruckWake-v0`."""

import sys
from collections.abc import Mapping, Sequence
from threading import Timer
from typing import Any, Final

import gymnasium
import numpy as np
import numpy.typing as npt

from contract.config.body import TRUCK_BODY, BodyConfig, layout_of
from contract.config.plant import FlowConfig
from contract.errors import ConfigError, PlantError
from contract.ledger import LEDGER_FIELDS
from contract.runtime.copies import CopiedWhole
from wake.pictures.drawing import WakePicture
from wake.plant.sample import Sample
from wake.truck.state import State, developed_state
from wake.truck.truck_wake import TruckWake

Observation = npt.NDArray[np.float32]

_SILENCE_S: Final = 3.0
"""Time in s after which a reset reports that the solver is being compiled; without compiling, a reset takes less."""


class TruckWakeEnv(CopiedWhole, gymnasium.Env[Observation, npt.NDArray[np.float32]]):
    """A Gymnasium environment of the wake. One step is one control period of 0.2 t_c.

    The observation is Cp at the named sensors, in the order of the names (float32). The action is the jet flow rate in
    U_inf W, shape (1,), from -0.075 to 0.075. The reward is -Cd of the wall. An episode never terminates; it is
    truncated at step `episode_steps` and every later step.

    At every step `info` holds the drag ledger, with the names and units of `wake.plant.sample.Sample`. `info` also has
    `clipped`, whether this step's action was clipped, and `clipped_count`, the episode's number of clipped actions.

    `reset` starts at a random phase of the shedding cycle: between 0 and `max_phase_steps` control periods without
    control after the start state. Equal seeds and actions give trajectories that are equal bit for bit, with any number
    of threads. Computed phases are stored, so only the first resets take long. `reset` accepts one of these options:

    - `phase_steps`: the phase in control periods, in place of a random phase;
    - `start`: the `wake.truck.state.State` from which the episode starts; it must be at the start of a control period.

    A copy or a pickle can be taken at any time. It is an independent environment. Its flow, actions, episode and random
    generators continue bit for bit as in the original. `copy.copy` and `copy.deepcopy` have equal results.

    Args:
        sensor_names: the observed sensors; by default all sensors, 90 for the truck.
        episode_steps: number of control steps until truncation.
        max_phase_steps: largest phase in control periods; 25 are about one shedding cycle. A stored phase takes 1.8 MB.
        start: flow state at phase 0; None means the shipped state (default body, Reynolds number and grid only).
        render_mode: None, or "rgb_array" for pictures of the vorticity, the jets and the observed sensors.
        body: the truck by default; another body needs `start`.

    `plant` is the `TruckWake` of the flow; `wake.truck.tape.Tape(env.unwrapped.plant)` differentiates it. Raises
    ConfigError if a sensor does not exist or is named twice, `sensor_names` is a single string, or a setting is out of
    its range; PlantError if the start state belongs to another plant or is not at the start of a control period, or if
    the time step is too large.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  (Gymnasium's own convention)

    def __init__(
        self,
        sensor_names: Sequence[str] | None = None,
        episode_steps: int = 500,
        config: FlowConfig | None = None,
        max_phase_steps: int = 25,
        start: State | None = None,
        render_mode: str | None = None,
        body: BodyConfig = TRUCK_BODY,
    ) -> None:
        for name, value, least in (("episode_steps", episode_steps, 1), ("max_phase_steps", max_phase_steps, 0)):
            if value < least:
                raise ConfigError(f"{name} = {value}: must be at least {least}")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ConfigError(f"render_mode = {render_mode!r}: must be None or 'rgb_array'")
        if isinstance(sensor_names, str):
            raise ConfigError(
                f"sensor_names = {sensor_names!r}: must be a sequence of names, such as [{sensor_names!r}]"
            )
        layout = layout_of(body)
        self._names = layout.names if sensor_names is None else tuple(sensor_names)
        self._columns = layout.indices(self._names)
        if not self._names:
            raise ConfigError("sensor_names is empty: observe at least one sensor")
        self.plant = TruckWake(config, body=body)
        self._episode_steps = episode_steps
        self._phases = [developed_state() if start is None else self._checked_start(start)]
        self._max_phase_steps = max_phase_steps
        self._step_count: int | None = None
        self._clipped_count = 0
        self._picture: WakePicture | None = None
        self.render_mode = render_mode
        limit = self.plant.config.action_limit
        self.action_space = gymnasium.spaces.Box(-limit, limit, shape=(1,), dtype=np.float32)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, shape=(len(self._names),), dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode. Raises ConfigError if an option does not exist or is out of its range; PlantError if the
        start state belongs to another plant or is not at the start of a control period."""
        super().reset(seed=seed)
        notice = Timer(_SILENCE_S, print, ["compiling the flow solver, once: up to a minute"], {"file": sys.stderr})
        notice.daemon = True
        notice.start()
        try:
            sample = self.plant.reset(self._start({} if options is None else options))
        finally:
            notice.cancel()
        self._step_count, self._clipped_count = 0, 0
        info = self._info(sample, clipped=False) | {"gradients": "wake.truck.tape.Tape(env.unwrapped.plant)"}
        return self._observe(sample), info

    def step(self, action: npt.NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Ramp the jets to `action` over one control period. Raises PlantError if the action is not one finite value;
        gymnasium.error.ResetNeeded before the first reset."""
        if self._step_count is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        values = np.asarray(action, dtype=np.float64)
        if values.size != 1:
            raise PlantError(f"action of shape {values.shape}: must be one value")
        commanded = float(values.item())
        if not np.isfinite(commanded):
            raise PlantError(f"action {commanded}: must be finite")
        limit = self.plant.config.action_limit
        # Rounding to float32 can increase the bound slightly.
        clipped = bool(abs(commanded) > np.float32(limit))
        sample = self.plant.advance(float(np.clip(commanded, -limit, limit)))
        self._step_count += 1
        self._clipped_count += clipped
        truncated = self._step_count >= self._episode_steps
        return self._observe(sample), -sample.Cd, False, truncated, self._info(sample, clipped)

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Draw the vorticity, the jets' arrows, and the observed sensors, coloured by Cp. Returns RGB (341, 1100, 3),
        or None if there is no render mode. Raises gymnasium.error.ResetNeeded before the first reset."""
        if self.render_mode is None:
            return None
        if self._step_count is None:
            raise gymnasium.error.ResetNeeded("call reset before render")
        if self._picture is None:
            self._picture = WakePicture(self.plant, "vorticity", self._names)
        return self._picture.pixels()

    def share_phases(self, other: "TruckWakeEnv") -> None:
        """Share the list of computed phases with another environment. Both must have equal settings and the same start
        state. Only one of the two may be reset at a time."""
        self._phases = other._phases

    def __getstate__(self) -> dict[str, Any]:
        # A picture belongs to one plant, so a copy of the environment builds its own picture at its first `render`.
        return self.__dict__ | {"_picture": None}

    def _start(self, options: Mapping[str, Any]) -> State:
        unknown = set(options) - {"start", "phase_steps"}
        if unknown or len(options) > 1:
            raise ConfigError(f"reset options {sorted(options)}: must be one of 'start' and 'phase_steps'")
        if "start" in options:
            return self._checked_start(options["start"])
        most = self._max_phase_steps
        phase = options.get("phase_steps")
        if phase is None:
            phase = int(self.np_random.integers(most + 1))
        if not isinstance(phase, int | np.integer) or not 0 <= phase <= most:
            raise ConfigError(f"phase_steps = {phase!r}: must be a whole number from 0 to max_phase_steps = {most}")
        if phase >= len(self._phases):
            self.plant.reset(self._phases[-1])
        while phase >= len(self._phases):
            self.plant.advance(0.0)
            self._phases.append(self.plant.state())
        return self._phases[phase]

    def _checked_start(self, start: Any) -> State:
        if not isinstance(start, State):
            raise ConfigError(f"start is a {type(start).__name__}: must be a wake.truck.state.State")
        if into := start.substep % self.plant.config.substeps:
            raise PlantError(f"start is {into} substeps inside a control period: must be at a period's start")
        return start

    def _observe(self, sample: Sample) -> Observation:
        return sample.Cp[self._columns].astype(np.float32)

    def _info(self, sample: Sample, clipped: bool) -> dict[str, Any]:
        names = ("t", *LEDGER_FIELDS, "Uy_probe", "action", "Cd_slot", "Cd_net")
        ledger = {name: getattr(sample, name) for name in names}
        return ledger | {"clipped": clipped, "clipped_count": self._clipped_count}


# This module registers the environment when it is imported, because Gymnasium 1.0 no longer reads entry points.
gymnasium.register(
    id="stillwake/TruckWake-v0",
    entry_point="wake.env:TruckWakeEnv",
    vector_entry_point="wake.vector_env:TruckWakeVectorEnv",
)
