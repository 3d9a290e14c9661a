"""The folder of a recording that is not finished: which recording it belongs to, and which call works on it.

`task.json` in it holds the recording's settings, so that only a call with the same ones continues it. `owner` holds the
call's token while one works; a worker that no longer finds its own there stops.
"""

import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from contract.atomic import replacing
from contract.errors import StillwakeError


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
