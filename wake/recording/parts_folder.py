"""A recording on disk that is not finished: which one it is, which call works on it, and its episodes block by block.

`task.json` in the folder holds the recording's settings, so that only a call with the same ones continues it. `owner`
holds the call's token while one works; a worker that no longer finds its own there stops.

A block is one file of samples, and next to it the state at its end: the flow and the policy's memory. The state is
written first, so that a block which is there can be continued; the state of an earlier block is then no longer needed.
Every file is there and whole or not there at all, so a recording that was stopped at any instant continues without a
seam.
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
    """Unfinished work of one output file; a folder an episode lies in it."""

    path: Path

    @classmethod
    def for_output(cls, output: Path) -> "PartsFolder":
        """The folder for the recording `output`. Its path is absolute: workers may run in another folder."""
        output = output.absolute()
        return cls(output.with_name(output.name + ".parts"))

    def claim(self, task: Mapping[str, Any], owner: str) -> None:
        """Make the folder this call's. Raises StillwakeError if it holds parts of another recording. `task` is the
        recording's settings, as plain JSON."""
        shutil.rmtree(self._done, ignore_errors=True)
        if self.path.is_dir() and any(path.is_dir() for path in self.path.iterdir()):
            self._check(task)
        else:
            # Nothing is recorded yet, whatever an earlier call was to record.
            with replacing(self._label) as temporary:
                temporary.write_text(json.dumps(task, sort_keys=True))
        with replacing(self._owner) as temporary:
            temporary.write_text(owner)

    def is_owned_by(self, owner: str) -> bool:
        """Whether the call with this token works on it; also False if the folder cannot be read from here."""
        try:
            return self._owner.read_text() == owner
        except OSError:
            return False

    def disown(self, owner: str) -> None:
        """End the work of the call with this token. A folder in which nothing is recorded goes with it.

        Where another call has taken over since, nothing changes.
        """
        if not self.is_owned_by(owner):
            return
        self._owner.unlink(missing_ok=True)
        if not self.has_samples:
            shutil.rmtree(self.path, ignore_errors=True)

    @property
    def has_samples(self) -> bool:
        """Whether a block of any episode is there, so that something can be continued."""
        return any(not path.name.endswith(".state.npz") for path in self.path.glob("*/[0-9]*.npz"))

    def task(self) -> dict[str, Any] | None:
        """The settings of its recording; None without a label that can be read."""
        try:
            task: dict[str, Any] = json.loads(self._label.read_text())
        except (OSError, ValueError):
            return None
        return task

    def clear(self) -> None:
        """Remove what is no longer needed; a call that is killed meanwhile leaves all of it or nothing."""
        shutil.rmtree(self._done, ignore_errors=True)
        self.path.replace(self._done)
        shutil.rmtree(self._done)

    def _check(self, task: Mapping[str, Any]) -> None:
        begun = self.task()
        if begun is None:
            raise StillwakeError(f"{self.path} holds parts of an unknown recording: delete it first")
        if begun != task:
            raise StillwakeError(
                f"{self.path} holds an unfinished recording with other settings ({differing(begun, task)}): finish it "
                f"with those, or delete it first"
            )

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
    """Names of the entries that are not equal, listed."""
    return ", ".join(sorted(key for key in a.keys() | b.keys() if a.get(key) != b.get(key)))


Series = Mapping[str, npt.NDArray[np.float64]]

_KEPT_STATES: Final = 2
"""One would do; the second is for a recording that starts while an orphan of an earlier one ends its last block."""


@dataclass(frozen=True, kw_only=True)
class EpisodeBlocks:
    """The blocks of one episode. A block has `block_steps` control steps; the last may be shorter."""

    folder: Path
    steps: int
    block_steps: int

    @property
    def finished(self) -> int:
        """Control steps in blocks that are there without a gap from the first on."""
        done = 0
        while done < self.steps and self._samples(done).is_file():
            done = min(done + self.block_steps, self.steps)
        return done

    def add(self, series: Series, end: State, memory: npt.NDArray[np.float64]) -> None:
        """Write the next block, with the flow's state and the policy's memory at its end. Raises StillwakeError if it
        cannot be written; earlier blocks stay."""
        first = self.finished
        _save(self._state(first), flat=end.flat, substep=end.substep, action=end.action, memory=memory)
        _save(self._samples(first), **series)
        for old in sorted(self.folder.glob("*.state.npz"))[:-_KEPT_STATES]:
            old.unlink(missing_ok=True)

    def end(self) -> tuple[State, npt.NDArray[np.float64]]:
        """The flow and the policy's memory at the end of the last finished block; there must be one."""
        first = (self.finished - 1) // self.block_steps * self.block_steps
        data = _load(self._state(first), ("flat", "substep", "action", "memory"))
        state = State(flat=data["flat"], substep=int(data["substep"]), action=float(data["action"]))
        return state, data["memory"]

    def series(self) -> Series:
        """Samples of all blocks; the episode must be finished."""
        blocks = [_load(self._samples(first), UNITS) for first in range(0, self.steps, self.block_steps)]
        return {name: np.concatenate([block[name] for block in blocks]) for name in UNITS}

    def _samples(self, first: int) -> Path:
        return self.folder / f"{first:06d}.npz"

    def _state(self, first: int) -> Path:
        return self.folder / f"{first:06d}.state.npz"


def _save(path: Path, **arrays: Any) -> None:
    # Packed in memory: a zip file that meets a full disk fails again when it is closed.
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
