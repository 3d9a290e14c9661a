"""The series of a log of a drive that is known, and how it is compared with the drive."""

import copy
from pathlib import Path
from typing import Any

import can
import numpy as np

from can_bridge.drives.log_periods import Scales
from can_bridge.drives.log_to_series import LogSeries, series_of
from contract.config.operating_point import OperatingPoint
from tests.can_bridge.drives.drive_log import Drive

SCALES = Scales(period=0.2, point=OperatingPoint(), action_limit=0.075)
LOG = Path("drive.blf")
EXACT = 1e-12
"""Two ways to multiply the same steps of the wire."""
KINDS = ("fd", "classic", "secured")


def read(messages: list[can.Message], **options: Any) -> LogSeries:
    return series_of(LOG, messages, SCALES, **{"fill": 2, "split": False, **options})


def in_time(messages: list[can.Message]) -> list[can.Message]:
    return sorted(messages, key=lambda message: message.timestamp)


def same(series: LogSeries, one: Drive, first: int = 0) -> None:
    (piece,) = series.pieces
    np.testing.assert_allclose(piece.Cp, one.Cp[first : first + len(piece)], atol=EXACT)
    np.testing.assert_allclose(piece.action, one.action[first : first + len(piece)], atol=EXACT)


def at(message: can.Message, time_s: float) -> can.Message:
    changed = copy.copy(message)
    changed.timestamp = time_s
    return changed


def noise(message: can.Message, generator: np.random.Generator) -> can.Message:
    changed = at(message, message.timestamp)
    changed.data = bytearray(generator.bytes(int(generator.integers(0, 65))))
    return changed
