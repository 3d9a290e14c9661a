"""Recorded drives of the bus as files: what an ECU received by period, and what each ECU answered.

A file is MessagePack by msgspec, packed by gzip. Of a state it has a checksum for each field, by which a change is
found and named.
"""

import gzip
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import nan
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from can_bridge.bus.interface import BusHealth
from can_bridge.wire.frame import Frame
from contract.atomic import replacing
from contract.errors import StillwakeError
from ecu.in_c.c_structs import flattened
from ecu.stepped import CalibratedEcu

SHELF: Final = Path(__file__).parent / "shelf"
SUFFIX: Final = ".msgpack.gz"


class ShelfError(StillwakeError):
    """A shelf, or a drive on it, that cannot be used."""


@dataclass(frozen=True, kw_only=True)
class Period:
    """What an ECU is given in a control period.

    Attributes:
        frames: received since the step before.
        updating: a new release is to be written.
        powered_on: the ECU lost its state before the step.
        calibration: packed values that it was given before the step; empty without.
    """

    now_ns: int
    frames: tuple[Frame, ...]
    health: BusHealth
    updating: bool
    powered_on: bool
    calibration: bytes


@dataclass(frozen=True, kw_only=True)
class Answers:
    """What an ECU answered, by period.

    Attributes:
        frames: that it sent.
        actions: that they command, U_inf W.
        modes, reasons: as they stand on the wire.
        states: checksums of each field of the state after the step, by its name.
    """

    frames: list[tuple[Frame, ...]] = field(default_factory=list)
    actions: list[float] = field(default_factory=list)
    modes: list[int] = field(default_factory=list)
    reasons: list[int] = field(default_factory=list)
    states: dict[str, list[int]] = field(default_factory=dict)

    def add(self, ecu: CalibratedEcu, sent: Sequence[Frame]) -> None:
        """Take down what an ECU answered in the step that it has just made."""
        trace, state = ecu.trace, ecu.state
        self.frames.append(tuple(sent))
        self.actions.append(trace.action)
        self.modes.append(int(trace.mode))
        self.reasons.append(int(state.fail_safe.reason))
        for name, value in flattened(state).items():
            self.states.setdefault(name, []).append(zlib.crc32(_content(value)))


def _content(value: Any) -> bytes:
    """The bits of a field; of the many that are no number any will do."""
    if isinstance(value, np.ndarray):
        return (np.where(np.isnan(value), nan, value) if value.dtype.kind == "f" else value).tobytes()
    return repr(value).encode()


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """A drive.

    Attributes:
        settings: of the vehicle, on top of the release's.
        digest: of the bundle that ran.
        answers: by the ECU, "python" or "c"; none of one that refuses these settings.
    """

    name: str
    sentence: str
    settings: tuple[str, ...]
    digest: str
    periods: list[Period]
    answers: dict[str, Answers]


def save(path: Path, drive: Recorded) -> None:
    """Write a drive, whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_bytes(gzip.compress(msgspec.msgpack.encode(drive), mtime=0))


def read(path: Path) -> Recorded:
    """Read a drive. Raises ShelfError for a file that is missing, damaged or of another making."""
    try:
        return msgspec.msgpack.decode(gzip.decompress(path.read_bytes()), type=Recorded)
    except (OSError, EOFError, zlib.error, msgspec.DecodeError) as error:
        raise ShelfError(f"{path}: {error}; make replay RENEW=1 records it again") from error
