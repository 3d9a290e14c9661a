"""An episode on disk while it is being recorded.

A block is one file of samples, and next to it the state at its end: the flow and the policy's memory. The state is
written first, so that a block which is there can be continued; the state of an earlier block is then no longer
needed. Every file is there and whole or not there at all, so a recording that was stopped at any instant continues
without a seam.
"""

import io
import os
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
