"""The job of recording one episode block by block. It holds all data that a process needs, including a controller."""

import hashlib
import platform
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from contract.arrays import Array
from contract.config.tree import Config
from contract.errors import PlantError, StillwakeError
from contract.recording.dataset import UNITS, Episode
from contract.results import versions
from contract.shipped import developed
from wake.plant.sample import Sample
from wake.recording.parts_folder import EpisodeBlocks, PartsFolder, Series, differing
from wake.recording.round_plan import Plan
from wake.solver.grid import box_grid
from wake.truck.state import State, check_body, check_grid, check_reynolds, developed_state, load_state
from wake.truck.truck_wake import TruckWake


class Policy(Protocol):
    """A feedback controller without hidden state. The caller stores the controller's memory, an array. So a recording
    can be stopped at any step and continued in another process."""

    def start(self) -> Array:
        """Return the controller's memory before the first sample."""

    def step(self, memory: Array, Cp: Array, action: float) -> tuple[float, Array]:
        """Compute the command at t_k and the new memory, without changing `memory`. Raises StillwakeError if there is
        no command.

        Args:
            memory: memory that the previous step returned.
            Cp: wall pressures at t_k, (90,).
            action: action in force at t_k, a_{k-1} after clipping, in U_inf W.
        """


PolicyFactory = Callable[[], Policy]
"""A function that builds a policy in the recording process; it must be picklable."""


class NoFeedback:
    """A policy whose command is always zero."""

    def start(self) -> Array:
        return np.empty(0)

    def step(self, memory: Array, Cp: Array, action: float) -> tuple[float, Array]:
        return 0.0, memory


EpisodeProgress = Callable[[str, int, int], None]
"""A function that is called with (name of the episode, steps done, total steps)."""


@dataclass(frozen=True, kw_only=True)
class EpisodeJob:
    """The data for recording one episode, in this process or in another process that shares the folder.

    Attributes:
        owner: token of the call of `record` that created the job; the job stops when another call owns the folder.
        block_steps: number of control steps between two writes to disk.
        setting: all settings that the samples depend on; see `setting_of`.
        policy: builds the controller; by default there is none, and only the plan's signal drives the jets.
        start: absolute path of the flow state in which the steps without forcing begin; None for the shipped state.
    """

    parts: PartsFolder
    owner: str
    plan: Plan
    config: Config
    block_steps: int
    setting: Mapping[str, Any]
    policy: PolicyFactory = NoFeedback
    start: Path | None = None

    @property
    def blocks(self) -> EpisodeBlocks:
        folder = self.parts.path / self.plan.name
        return EpisodeBlocks(folder=folder, steps=self.plan.steps, block_steps=self.block_steps)

    def run(self, wake: TruckWake | None = None, progress: EpisodeProgress = lambda name, done, total: None) -> None:
        """Record the missing blocks; `wake` is built if not given. Raises PlantError if the flow diverges. Raises
        StillwakeError if this process does not find the folder or cannot write a block, if the process that began the
        recording had other versions or another start, or if another call has taken over."""
        if not self.parts.is_owned_by(self.owner):
            raise StillwakeError(f"{platform.node()} does not find {self.parts.path}: it must be in a shared folder")
        mine = setting_of(self.config, self.plan.packages, self.start)
        if mine != self.setting:
            raise StillwakeError(f"{platform.node()} has another value of: {differing(mine, self.setting)}")
        plan, blocks = self.plan, self.blocks
        if blocks.finished == plan.steps:
            return
        wake = TruckWake(self.config.flow, body=self.config.body) if wake is None else wake
        signal, policy = plan.signal(self.config), self.policy()
        first = blocks.finished
        if first:
            state, memory = blocks.end()
            sample = wake.reset(state)
        else:
            memory = policy.start()
            sample = wake.reset(_state_in(self.start))
            for _ in range(plan.lead):
                sample = wake.advance(0.0)
        while first < plan.steps:
            if not self.parts.is_owned_by(self.owner):
                raise StillwakeError(f"{self.parts.path}: stopped, or taken over by another call")
            block = signal[first : first + self.block_steps]
            series, sample, memory = _advance(wake, sample, policy, memory, block)
            blocks.add(series, wake.state(), memory)
            first += len(block)
            progress(plan.name, first, plan.steps)

    def episode(self) -> Episode:
        """Read the finished episode from its blocks."""
        return Episode(
            name=self.plan.name,
            role=self.plan.role,
            series=self.blocks.series(),
            initial_action=0.0 if self.plan.lead else _state_in(self.start).action,
            provenance=self.provenance,
        )

    @property
    def provenance(self) -> dict[str, Any]:
        """The episode's provenance as the data set stores it, as plain JSON."""
        return {**self.setting, **self.plan.provenance}


def setting_of(config: Config, packages: tuple[str, ...] = (), start: Path | None = None) -> dict[str, Any]:
    """Return all settings outside the plan that determine the samples, including the versions of `packages`, as plain
    JSON. Raises PlantError if the start's file cannot be read."""
    return {
        "body": asdict(config.body),
        # Older recordings do not hold the refinement, so it is left out. The entry "grid" has the resolution.
        "flow": {name: value for name, value in asdict(config.flow).items() if name != "refinement"},
        "forcing": asdict(config.forcing),
        "grid": list(box_grid(config.body.length, config.flow.refinement).shape),
        # The file's name and hash identify the state; the file's path is valid on one machine only.
        "start": (developed() if start is None else start).name,
        "start_sha256": _sha256(developed() if start is None else start),
        "versions": {
            "python": platform.python_version(),
            **versions("stillwake", "numpy", "numba", "scipy", *packages),
        },
    }


def check_start(config: Config, start: Path | None) -> None:
    """Raise PlantError if a plant of this configuration cannot start in the state of the file `start`. No plant is
    built for the check."""
    origin = _state_in(start).origin
    if origin is not None:
        check_body(origin, config.body)
        check_reynolds(origin, config.flow.reynolds)
        check_grid(origin, box_grid(config.body.length, config.flow.refinement).shape)


def _sha256(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise PlantError(f"{path}: not a flow state ({error.strerror or error})") from error


def _state_in(start: Path | None) -> State:
    return developed_state() if start is None else load_state(start)


def _advance(
    wake: TruckWake, sample: Sample, policy: Policy, memory: Array, signal: Array
) -> tuple[Series, Sample, Array]:
    """Return the samples of a block from `sample` on, the sample after the block, and the policy's memory at the
    block's end. Each action is the policy's command plus the signal, clipped to the bound; the policy receives it one
    step later."""
    rows: list[Sample] = []
    actions = np.empty(len(signal))
    limit = wake.config.action_limit
    for k, added in enumerate(signal):
        rows.append(sample)
        command, memory = policy.step(memory, sample.Cp, sample.action)
        actions[k] = np.clip(command + added, -limit, limit)
        sample = wake.advance(float(actions[k]))
    series = {name: np.array([getattr(row, name) for row in rows]) for name in UNITS}
    # A sample has the action in force at its time; a recording has the action commanded at that time.
    return series | {"action": actions}, sample, memory
