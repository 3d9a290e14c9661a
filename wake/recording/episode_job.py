"""The job that records one episode block by block, and the folder of an unfinished recording.

`task.json` holds the recording's settings; only a call with equal settings continues the recording. `owner` holds the
token of the call that records; a worker stops if the token changes. Each block has a file of samples, and a file
of the state at its end (the flow and the policy's memory). The state is written first, so that every complete block can
be continued. A file is either complete or absent, so a stopped recording continues as if it had not been stopped.
"""

import hashlib
import io
import json
import os
import platform
import shutil
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from contract.arrays import Array
from contract.atomic import replacing
from contract.config.tree import Config
from contract.errors import PlantError, StillwakeError
from contract.npz import read_npz
from contract.recording.dataset import UNITS, Episode
from contract.results import versions
from contract.shipped import developed
from wake.plant.sample import Sample
from wake.recording.plans import Plan
from wake.solver.grid import box_grid
from wake.truck.state import State, check_origin, developed_state, load_state
from wake.truck.truck_wake import TruckWake


@dataclass(frozen=True)
class PartsFolder:
    """The folder of the unfinished work for one output file; it has a subfolder for each episode."""

    path: Path

    @classmethod
    def for_output(cls, output: Path) -> "PartsFolder":
        """Return the folder for `output`, as an absolute path, because workers may have another working directory."""
        output = output.absolute()
        return cls(output.with_name(output.name + ".parts"))

    def claim(self, task: Mapping[str, Any], owner: str) -> None:
        """Make this call the owner of the folder. Raises StillwakeError if the folder holds parts of another recording.
        `task` contains the recording's settings, as plain JSON."""
        shutil.rmtree(self._done, ignore_errors=True)
        if self.path.is_dir() and any(path.is_dir() for path in self.path.iterdir()):
            begun = self.task()
            if begun is None:
                raise StillwakeError(f"{self.path} holds parts of an unknown recording: delete this folder first")
            if begun != task:
                raise StillwakeError(
                    f"{self.path} holds an unfinished recording with other settings ({differing(begun, task)}): finish "
                    f"it with its own settings, or delete this folder first"
                )
        else:
            # No block is recorded yet, so the settings of an earlier call may be replaced.
            with replacing(self.path / "task.json") as temporary:
                temporary.write_text(json.dumps(task, sort_keys=True))
        with replacing(self.path / "owner") as temporary:
            temporary.write_text(owner)

    def is_owned_by(self, owner: str) -> bool:
        """Return whether the call with this token owns the folder; False if this machine cannot read the folder."""
        try:
            return (self.path / "owner").read_text() == owner
        except OSError:
            return False

    def disown(self, owner: str) -> None:
        """End the ownership of this call, and remove a folder without samples. Do nothing if another call owns it."""
        if not self.is_owned_by(owner):
            return
        (self.path / "owner").unlink(missing_ok=True)
        if not self.has_samples:
            shutil.rmtree(self.path, ignore_errors=True)

    @property
    def has_samples(self) -> bool:
        """Whether a block of any episode exists. The recording can then continue from this block."""
        return any(not path.name.endswith(".state.npz") for path in self.path.glob("*/[0-9]*.npz"))

    def task(self) -> dict[str, Any] | None:
        """Read the settings of the recording; None if they cannot be read."""
        try:
            task: dict[str, Any] = json.loads((self.path / "task.json").read_text())
            return task
        except (OSError, ValueError):
            return None

    def clear(self) -> None:
        """Remove the folder. If the process is killed while it does this, the folder is either complete or absent."""
        shutil.rmtree(self._done, ignore_errors=True)
        self.path.replace(self._done)
        shutil.rmtree(self._done)

    @property
    def _done(self) -> Path:
        return self.path.with_name(self.path.name + ".done")


def differing(a: Mapping[str, Any], b: Mapping[str, Any]) -> str:
    """List the names of the entries in which `a` and `b` differ."""
    return ", ".join(sorted(key for key in a.keys() | b.keys() if a.get(key) != b.get(key)))


Series = Mapping[str, npt.NDArray[np.float64]]

_KEPT_STATES: Final = 2
"""Number of states that are stored for an episode: one to continue from, and one because a worker of a killed recording
may write one more block while a new recording starts."""


@dataclass(frozen=True, kw_only=True)
class EpisodeBlocks:
    """The blocks of one episode. A block has `block_steps` control steps; the last block may be shorter."""

    folder: Path
    steps: int
    block_steps: int

    @property
    def finished(self) -> int:
        """Number of control steps in the blocks before the first missing block."""
        done = 0
        while done < self.steps and self._samples(done).is_file():
            done = min(done + self.block_steps, self.steps)
        return done

    def add(self, series: Series, end: State, memory: npt.NDArray[np.float64]) -> None:
        """Write the next block, with the flow's state and the policy's memory at its end. Raises StillwakeError if the
        block cannot be written; earlier blocks remain."""
        first = self.finished
        _save(self._state(first), flat=end.flat, substep=end.substep, action=end.action, memory=memory)
        _save(self._samples(first), **series)
        for old in sorted(self.folder.glob("*.state.npz"), key=lambda path: (len(path.name), path))[:-_KEPT_STATES]:
            old.unlink(missing_ok=True)

    def end(self) -> tuple[State, npt.NDArray[np.float64]]:
        """Read the flow and the policy's memory at the end of the last finished block, which must exist."""
        first = (self.finished - 1) // self.block_steps * self.block_steps
        data = _load(self._state(first), ("flat", "substep", "action", "memory"))
        state = State(flat=data["flat"], substep=int(data["substep"]), action=float(data["action"]))
        return state, data["memory"]

    def series(self) -> Series:
        """Read the samples of all blocks; the episode must be finished."""
        blocks = [_load(self._samples(first), UNITS) for first in range(0, self.steps, self.block_steps)]
        return {name: np.concatenate([block[name] for block in blocks]) for name in UNITS}

    def _samples(self, first: int) -> Path:
        return self.folder / f"{first:06d}.npz"

    def _state(self, first: int) -> Path:
        return self.folder / f"{first:06d}.state.npz"


def _save(path: Path, **arrays: Any) -> None:
    # The file is built in memory, because a zip file on a full disk fails a second time when it is closed.
    image = io.BytesIO()
    np.savez(image, **arrays)
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(image.getbuffer())
        file.flush()
        os.fsync(file.fileno())


def _load(path: Path, names: Mapping[str, str] | tuple[str, ...]) -> dict[str, npt.NDArray[np.float64]]:
    try:
        data = read_npz(path)
        return {name: data[name] for name in names}
    except (OSError, ValueError) as error:
        raise StillwakeError(f"{path}: block is damaged ({error}); delete it to record the block again") from error


class Policy(Protocol):
    """A feedback controller without hidden state. The caller stores the controller's memory, an array. So a recording
    can be stopped at any step and continued in another process."""

    def start(self) -> Array:
        """Return the controller's memory before the first sample."""

    def step(self, memory: Array, Cp: Array, action: float) -> tuple[float, Array]:
        """Compute the command at t_k and the new memory, without changing `memory`, from Cp of all n sensors (n,) and
        the action in force in U_inf W: the previous step's action a_{k-1} after clipping. Raises StillwakeError if the
        controller gives no command."""


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
    """All data for recording one episode, in this process or in another process that shares the folder. `owner` is the
    token of the call of `record` that created the job; the job stops when another call owns the folder. A block has
    `block_steps` control steps. `setting` is the result of `setting_of`. The plan's `lead` begins in the flow state at
    the absolute path `start`; None means the shipped state."""

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
            raise StillwakeError(f"{platform.node()} differs from the caller in {differing(mine, self.setting)}")
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
                raise StillwakeError(f"{self.parts.path}: the recording was stopped, or taken over by another call")
            block = signal[first : first + self.block_steps]
            series, sample, memory = _advance(wake, sample, policy, memory, block)
            blocks.add(series, wake.state(), memory)
            first += len(block)
            progress(plan.name, first, plan.steps)

    def episode(self) -> Episode:
        """Read the finished episode from its blocks."""
        plan, action = self.plan, 0.0 if self.plan.lead else _state_in(self.start).action
        series, about = self.blocks.series(), self.provenance
        return Episode(name=plan.name, role=plan.role, series=series, initial_action=action, provenance=about)

    @property
    def provenance(self) -> dict[str, Any]:
        """The episode's provenance as the data set stores it, as plain JSON."""
        return {**self.setting, **self.plan.provenance}


def setting_of(config: Config, packages: tuple[str, ...] = (), start: Path | None = None) -> dict[str, Any]:
    """Return all settings outside the plan that determine the samples, and the versions of the software and `packages`,
    as plain JSON. Raises PlantError if the start's file cannot be read."""
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
    """Raise PlantError if a plant of this configuration cannot start in the state of the file `start`."""
    shape = box_grid(config.body.length, config.flow.refinement).shape
    check_origin(_state_in(start).origin, config.body, config.flow.reynolds, shape)


def _sha256(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise PlantError(f"{path} is not a flow state ({error.strerror or error})") from error


def _state_in(start: Path | None) -> State:
    return developed_state() if start is None else load_state(start)


def _advance(
    wake: TruckWake, sample: Sample, policy: Policy, memory: Array, signal: Array
) -> tuple[Series, Sample, Array]:
    """Return the samples of a block from `sample` on, the sample after it, and the policy's memory at its end."""
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
