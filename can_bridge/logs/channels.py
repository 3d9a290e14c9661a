"""Named channels: values over time with units, in groups that share their times, for every format of measurements."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from contract.arrays import Array


class NamedChannel(NamedTuple):
    """A quantity over the times of its group.

    Attributes:
        unit: unit as in `contract/stillwake.dbc`; empty if there is none.
        values: one value for each of the group's n times, (n,); NaN where there is no value.
        words: names of the values, for an enumeration; empty for a number.
    """

    name: str
    unit: str
    values: Array
    words: Mapping[int, str] = {}

    @property
    def identifier(self) -> str:
        """The name with its unit, for formats that have no field for units: Pressure0_Pa, Speed_m_per_s."""
        return re.sub(r"\W+", "_", f"{self.name} {self.unit.replace('/', '_per_')}".strip())


@dataclass(frozen=True, kw_only=True, eq=False)
class ChannelGroup:
    """Channels with common times.

    Attributes:
        name: name of the message, or of a part of a run; unique in a file.
        times_s: the n times of the values in s, (n,), not decreasing.
    """

    name: str
    times_s: Array
    channels: tuple[NamedChannel, ...]
    comment: str = ""
