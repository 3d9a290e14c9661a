"""An unfinished recording on disk: its settings, the call that records, and the episodes block by block.

`task.json` holds the recording's settings, so that only a call with equal settings continues it. `owner` holds the
token of the call that records; a worker stops when it finds another token. Each block has a file of samples, and a file
of the state at its end (the flow and the policy's memory). The state is written first, so that every complete block can
be continued. A file is either complete or absent, so a stopped recording continues as if it had not been stopped.
"""

import io
import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from contract.atomic import replacing
from contract.errors import StillwakeError
from contract.npz import read_npz
from contract.recording.dataset import UNITS
from wake.truck.state import State


@dataclass(frozen=True)
class PartsFolder:
    """The folder of the unfinished work for one output file; it has a subfolder for each episode."""

    path: Path

    @classmethod
    def for_output(cls, output: Path) -> "PartsFolder":
        """Return the folder for `output`. The folder's path is absolute, because workers may have another working
        directory."""
        output = output.absolute()
        return cls(output.with_name(output.name + ".parts"))

    def claim(self, task: Mapping[str, Any], owner: str) -> None:
        """Make this call the owner of the folder. Raises StillwakeError if the folder holds parts of another recording.
        `task` contains the recording's settings, as plain JSON."""
        shutil.rmtree(self._done, ignore_errors=True)
        if self.path.is_dir() and any(path.is_dir() for path in self.path.iterdir()):
            begun = self.task()
            if begun is None:
                raise StillwakeError(f"{self.path} holds parts of an unknown recording: delete it first")
            if begun != task:
                raise StillwakeError(
                    f"{self.path} holds an unfinished recording with other settings ({differing(begun, task)}): finish "
                    f"it with these settings, or delete it first"
                )
        else:
            # No block is recorded yet, so the settings of an earlier call may be replaced.
            with replacing(self._label) as temporary:
                temporary.write_text(json.dumps(task, sort_keys=True))
        with replacing(self._owner) as temporary:
            temporary.write_text(owner)

    def is_owned_by(self, owner: str) -> bool:
        """Return whether the call with this token owns the folder; also False if the folder cannot be read here."""
        try:
            return self._owner.read_text() == owner
        except OSError:
            return False

    def disown(self, owner: str) -> None:
        """End the ownership of the call with this token, and remove the folder if it holds no samples. Do nothing if
        another call owns the folder."""
        if not self.is_owned_by(owner):
            return
        self._owner.unlink(missing_ok=True)
        if not self.has_samples:
            shutil.rmtree(self.path, ignore_errors=True)

    @property
    def has_samples(self) -> bool:
        """Whether a block of any episode exists. The recording can then continue from this block."""
        return any(not path.name.endswith(".state.npz") for path in self.path.glob("*/[0-9]*.npz"))

    def task(self) -> dict[str, Any] | None:
        """Read the settings of the recording; None if they cannot be read."""
        try:
            task: dict[str, Any] = json.loads(self._label.read_text())
        except (OSError, ValueError):
            return None
        return task

    def clear(self) -> None:
        """Remove the folder. If the process is killed meanwhile, the folder exists either with all its contents or not
        at all."""
        shutil.rmtree(self._done, ignore_errors=True)
        self.path.replace(self._done)
        shutil.rmtree(self._done)

    @property
    def _label(self) -> Path:
        return self.path / "task.json"

    @property
    def _owner(self) -> Path:
        return self.path / "owner"

    @property
    def _done(self) -> Path:
        return self.path.with_name(self.path.name + ".done")


def differing(a: Mapping[str, Any], b: Mapping[str, Any]) -> str:
    """List the names of the entries that are not equal."""
    return ", ".join(sorted(key for key in a.keys() | b.keys() if a.get(key) != b.get(key)))


Series = Mapping[str, npt.NDArray[np.float64]]

_KEPT_STATES: Final = 2
"""Number of states that are stored for an episode. One state is enough to continue. A second state is needed because a
worker of an earlier, dead recording may finish its last block while a new recording starts."""


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
        for old in sorted(self.folder.glob("*.state.npz"))[:-_KEPT_STATES]:
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
        raise StillwakeError(f"{path}: damaged block ({error}); delete it to record it again") from error
