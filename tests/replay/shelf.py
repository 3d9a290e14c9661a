"""Recorded drives of the bus as files: an ECU's inputs in each period, and each ECU's answers.

A file is MessagePack by msgspec, compressed by gzip. It has a checksum for each field of a state, which shows the
fields that a change affects.
"""

import gzip
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from math import nan
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from can_bridge.bus.interface import BusHealth
from can_bridge.wire.frame import Frame
from contract.atomic import replacing
from contract.errors import StillwakeError
from ecu.controller_memory import DelayLine
from ecu.stepped import CalibratedEcu

SHELF: Final = Path(__file__).parent / "shelf"
SUFFIX: Final = ".msgpack.gz"


class ShelfError(StillwakeError):
    """The folder of recordings, or a drive in it, cannot be used."""


@dataclass(frozen=True, kw_only=True)
class Period:
    """The inputs of an ECU in a control period: the frames since the step before, whether a release is to be written,
    whether the ECU lost its state before the step, and packed values that it was given before it."""

    now_ns: int
    frames: tuple[Frame, ...]
    health: BusHealth
    updating: bool
    powered_on: bool
    calibration: bytes


@dataclass(frozen=True, kw_only=True)
class Answers:
    """The answers of an ECU, by period: sent frames, commanded actions in U_inf W, modes and reasons as on the bus, and
    checksums of each field of the state after the step, by the field's name."""

    frames: list[tuple[Frame, ...]] = field(default_factory=list)
    actions: list[float] = field(default_factory=list)
    modes: list[int] = field(default_factory=list)
    reasons: list[int] = field(default_factory=list)
    states: dict[str, list[int]] = field(default_factory=dict)

    def add(self, ecu: CalibratedEcu, sent: Sequence[Frame]) -> None:
        trace, state = ecu.trace, ecu.state
        self.frames.append(tuple(sent))
        self.actions.append(trace.action)
        self.modes.append(int(trace.mode))
        self.reasons.append(int(state.fail_safe.reason))
        for name, value in _leaves(state):
            self.states.setdefault(name, []).append(zlib.crc32(_content(value)))


def _leaves(value: object, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted name and the value of each field of a state, or of any part of it."""
    if not is_dataclass(value) or isinstance(value, type | DelayLine):
        yield name.removeprefix("."), value
        return
    for item in fields(value):
        yield from _leaves(getattr(value, item.name), f"{name}.{item.name}")


def _content(value: Any) -> bytes:
    """Return the bits of a field, with one pattern for all NaNs."""
    if isinstance(value, np.ndarray):
        return (np.where(np.isnan(value), nan, value) if value.dtype.kind == "f" else value).tobytes()
    return repr(value).encode()


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """A recorded drive, with the digest of the bundle that ran. An ECU that refuses the settings of the vehicle is
    missing in `answers`; the others are "python" and "c"."""

    name: str
    sentence: str
    settings: tuple[str, ...]
    digest: str
    periods: list[Period]
    answers: dict[str, Answers]


def save(path: Path, drive: Recorded) -> None:
    with replacing(path) as temporary:
        temporary.write_bytes(gzip.compress(msgspec.msgpack.encode(drive), mtime=0))


def read(path: Path) -> Recorded:
    """Read a drive. Raises ShelfError if the file is missing, damaged or in another format."""
    try:
        return msgspec.msgpack.decode(gzip.decompress(path.read_bytes()), type=Recorded)
    except (OSError, EOFError, zlib.error, msgspec.DecodeError) as error:
        raise ShelfError(f"{path}: {error}; make replay RENEW=1 records it again") from error
