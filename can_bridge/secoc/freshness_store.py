"""The data that must survive a power cycle: the number of power cycles, and the newest accepted freshness values.

Each node has a JSON file of its own. `begin` counts the power cycle before the first frame is sent, so that no
freshness value is used twice. `accepted` stores the newest freshness value from the other node: immediately after the
other node's power-on, otherwise once in `every` frames, because flash memory wears. A restarted node refuses every
frame whose value is not above the stored value; docs/explanation/protection.md describes the gap that remains.
"""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import LARGEST_FRESHNESS, LARGEST_HALF, Authentication
from contract.atomic import replacing
from contract.errors import BusError

FRESHNESS_SCHEMA: Final = "stillwake-freshness/1"


class FreshnessStore:
    """The file with a node's freshness values. Only one process may use the file at a time."""

    def __init__(self, path: Path, *, every: int = 50) -> None:
        if every < 1:
            raise ValueError(f"every {every}: must be at least 1")
        self._path = path
        self._every = every
        self._trip = 0
        self._heard: Mapping[int, int] = {}

    def begin(self, key: Key) -> Authentication:
        """Count a power cycle, and return the node's authentication data for this cycle.

        If the file is missing, power cycles count from 1 again, so the other node refuses every frame of this node, and
        this node accepts old frames until a genuine frame arrives. Raises BusError if the file is damaged, or if power
        cycles have reached their largest number; StillwakeError if the file cannot be written.
        """
        before, heard = self._read()
        if before >= LARGEST_HALF:
            raise BusError(f"{self._path}: {before} power cycles are the maximum; start with another key")
        self._keep(before + 1, heard)
        return Authentication(key=key, trip=self._trip, heard=self._heard)

    def accepted(self, frame_id: int, freshness: int) -> None:
        """Process the newest accepted value: write it if a write is due. Raises StillwakeError if writing fails."""
        kept = self._heard.get(frame_id, 0)
        if freshness >> 32 != kept >> 32 or freshness - kept >= self._every:
            self._keep(self._trip, {**self._heard, frame_id: freshness})

    def _read(self) -> tuple[int, dict[int, int]]:
        """Return the number of power cycles so far, and the newest stored freshness value by frame identifier."""
        try:
            tree = json.loads(self._path.read_text(encoding="utf-8"))
            if tree["schema"] != FRESHNESS_SCHEMA:
                raise ValueError(f"the schema is {tree['schema']!r}: must be {FRESHNESS_SCHEMA!r}")
            heard = {int(frame_id): _whole(value, LARGEST_FRESHNESS) for frame_id, value in tree["heard"].items()}
            return _whole(tree["trip"], LARGEST_HALF), heard
        except FileNotFoundError:
            return 0, {}
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise BusError(
                f"{self._path}: not a freshness file ({error}); the key must not be used without a valid file: "
                "remove the file and give both nodes a new key"
            ) from error

    def _keep(self, trip: int, heard: Mapping[int, int]) -> None:
        tree = {"schema": FRESHNESS_SCHEMA, "trip": trip, "heard": {str(k): v for k, v in sorted(heard.items())}}
        try:
            with replacing(self._path) as temporary, temporary.open("w", encoding="utf-8") as file:
                json.dump(tree, file)
                file.flush()
                os.fsync(file.fileno())
            # The new directory entry, too, has to be on the disk before the first frame is sent.
            folder = os.open(self._path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
        except OSError as error:
            raise BusError(f"cannot write {self._path}: {error.strerror or error}") from error
        self._trip, self._heard = trip, heard


def _whole(value: Any, largest: int) -> int:
    if type(value) is not int or not 0 <= value <= largest:
        raise ValueError(f"{value!r}: must be a whole number in 0..{largest}")
    return value
