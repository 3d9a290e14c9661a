"""The data that must survive a power cycle: the number of power cycles, and the newest accepted freshness values.

Each node has a JSON file of its own. `begin` counts the power cycle before the first frame is sent, so that no
freshness value is used twice. `accepted` stores the newest freshness value from the other node. This happens
immediately when the other node has begun another power cycle, and otherwise once in `every` frames, because flash
memory wears. A restarted node refuses every frame whose value is not above the stored value. One gap remains: up to
`every` frames were accepted after the stored value, and these frames can be replayed to a node that has just restarted,
until the first genuine frame arrives.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from can_bridge.secoc.key import Key
from can_bridge.secoc.node import Authentication
from can_bridge.secoc.securing import LARGEST_FRESHNESS, LARGEST_HALF
from contract.atomic import replacing
from contract.errors import BusError

FRESHNESS_SCHEMA: Final = "stillwake-freshness/1"


@dataclass(frozen=True, kw_only=True)
class FreshnessRecord:
    """The content of the file.

    Attributes:
        trip: number of power cycles so far.
        heard: newest stored freshness value, by frame identifier.
    """

    trip: int = 0
    heard: Mapping[int, int] = field(default_factory=dict)


def is_due(kept: int, freshness: int, every: int) -> bool:
    """Return whether to store a value: whether the sender has begun another power cycle, or has sent `every` or more
    frames since the stored value."""
    return freshness >> 32 != kept >> 32 or freshness - kept >= every


class FreshnessStore:
    """The file with a node's freshness values, which only one process may use at a time.

    Args:
        path: path of the file; the first `begin` creates it.
        every: number of frames between two writes.
    """

    def __init__(self, path: Path, *, every: int = 50) -> None:
        if every < 1:
            raise ValueError(f"every {every}: must be at least 1")
        self._path = path
        self._every = every
        self._record = FreshnessRecord()

    def begin(self, key: Key) -> Authentication:
        """Count a power cycle, and return the node's authentication data for this cycle.

        If the file is missing, power cycles count from 1 again. This is safe and is noticed, because the other node
        then refuses every frame. Raises BusError if the file is damaged, or if power cycles have reached their largest
        number; StillwakeError if the file cannot be written.
        """
        before = self._read()
        if before.trip >= LARGEST_HALF:
            raise BusError(f"{self._path}: {before.trip} power cycles are the maximum; start with another key")
        self._keep(FreshnessRecord(trip=before.trip + 1, heard=before.heard))
        return Authentication(key=key, trip=self._record.trip, heard=self._record.heard)

    def accepted(self, frame_id: int, freshness: int) -> None:
        """Note the value that a receiver accepted last; the method may be called after every frame. Raises
        StillwakeError if the file cannot be written."""
        if is_due(self._record.heard.get(frame_id, 0), freshness, self._every):
            heard = {**self._record.heard, frame_id: freshness}
            self._keep(FreshnessRecord(trip=self._record.trip, heard=heard))

    def _read(self) -> FreshnessRecord:
        try:
            tree = json.loads(self._path.read_text(encoding="utf-8"))
            return _record_of(tree)
        except FileNotFoundError:
            return FreshnessRecord()
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise BusError(
                f"{self._path}: not a freshness file ({error}); without a valid file the key must not be used again: "
                "remove the file and give both nodes a new key"
            ) from error

    def _keep(self, record: FreshnessRecord) -> None:
        tree = {
            "schema": FRESHNESS_SCHEMA,
            "trip": record.trip,
            "heard": {str(k): v for k, v in sorted(record.heard.items())},
        }
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
        self._record = record


def _record_of(tree: Any) -> FreshnessRecord:
    """Convert content that `_keep` wrote; raise ValueError, KeyError, TypeError or AttributeError for other content."""
    if tree["schema"] != FRESHNESS_SCHEMA:
        raise ValueError(f"schema {tree['schema']!r}, must be {FRESHNESS_SCHEMA!r}")
    heard = {int(frame_id): _whole(value, LARGEST_FRESHNESS) for frame_id, value in tree["heard"].items()}
    return FreshnessRecord(trip=_whole(tree["trip"], LARGEST_HALF), heard=heard)


def _whole(value: Any, largest: int) -> int:
    if type(value) is not int or not 0 <= value <= largest:
        raise ValueError(f"{value!r}: must be a whole number in 0..{largest}")
    return value
