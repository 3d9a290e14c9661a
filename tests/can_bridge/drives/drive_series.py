"""How the tests read a made-up log, and what they compare with the drive behind it."""

from pathlib import Path
from typing import Any

import can
import numpy as np

from can_bridge.drives.log_periods import Scales
from can_bridge.drives.log_to_series import LogSeries, series_of
from tests.can_bridge.drives.drive_log import FLOW, PERIOD, PRESSURE, Drive

SCALES = Scales(period_s=PERIOD, dynamic_pressure=PRESSURE, flow_rate=FLOW, action_limit=0.075)
LOG = Path("drive.blf")
EXACT = 1e-12
"""Two ways to multiply the same steps of the wire."""
KINDS = ("fd", "classic", "secured")


def read(messages: list[can.Message], **options: Any) -> LogSeries:
    return series_of(LOG, messages, SCALES, **{"fill": 2, "split": False, **options})


def same(series: LogSeries, one: Drive, first: int = 0) -> None:
    (piece,) = series.pieces
    np.testing.assert_allclose(piece.Cp, one.Cp[first : first + len(piece)], atol=EXACT)
    np.testing.assert_allclose(piece.action, one.action[first : first + len(piece)], atol=EXACT)
