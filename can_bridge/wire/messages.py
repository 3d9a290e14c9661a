"""The four messages in engineering units. `contract/stillwake.dbc` defines each signal.

They are named tuples, because a message is built for every frame, and building a frozen dataclass takes several times
longer. Name the fields where you build one.
"""

from enum import IntEnum
from typing import Final, NamedTuple

SENSORS: Final = 4
"""Number of pressures in a Pressure message."""

COUNT_LIMIT: Final = 0xFFFF
"""Largest value of the 16-bit event counts of EcuStatus, at which they stay."""

BUS_OFF_LIMIT: Final = 0xFF
"""Largest value of EcuStatus's bus-off count, at which it stays."""

ERROR_LIMIT: Final = 0xFF
"""Largest sent value of the CAN controller's error counters; also sent for 256, which is bus-off."""


SET_ASIDE_LIMIT: Final = 0b1111
"""Bits of all four pressures."""


class Mode(IntEnum):
    """State of the control loop in EcuStatus, and origin of the command in JetCommand."""

    OFF = 0
    WARMUP = 1
    CONTROL = 2
    HOLD = 3
    DECAY = 4
    FAULT = 5


class Reason(IntEnum):
    """The reason why the jets do not follow the controller."""

    NONE = 0
    STREAM_LOST = 1
    STREAM_INVALID = 2
    DEADLINE = 3
    BUS_OFF = 4
    INTERNAL = 5
    SENSOR_INVALID = 6
    STALE = 7
    NOT_AUTHENTIC = 8
    CLOCK = 9
    IMPLAUSIBLE = 10
    NOT_ARMED = 11
    OTHER_ECU = 12
    NO_RELEASE = 13
    UPDATING = 14
    NOT_HELPING = 15
    NO_SPEED = 16
    """The vehicle's speed is unknown or not trusted."""
    OFF_SPEED = 17
    """The vehicle's speed is outside the release's range."""


class Pressure(NamedTuple):
    """Wall pressures of one instant.

    Attributes:
        pressure_pa: relative to the free stream, (4,), in the order of the bundle's sensors.
        valid: results of the sensors' own diagnosis, (4,).
        enable_request: the vehicle requests control.
        age_ns: time from sampling until the frame is passed to the bus.
    """

    pressure_pa: tuple[float, ...]
    valid: tuple[bool, ...]
    enable_request: bool
    age_ns: int


class VehicleSpeed(NamedTuple):
    """The vehicle's speed and the density of its air.

    Attributes:
        speed_m_per_s: vehicle's speed, at least 0; None if the vehicle does not know it.
        age_ns: time from measuring the speed until the frame is passed to the bus.
        density_kg_per_m3: density of the air, above 0; None if unknown.
    """

    speed_m_per_s: float | None
    age_ns: int
    density_kg_per_m3: float | None = None


class JetCommand(NamedTuple):
    """The jets' flow rate to be reached by the end of a control period.

    Attributes:
        flow_m2_per_s: out of the upper slot and into the lower, per unit span.
        enable: False shuts the jets at any flow.
        pressure_counter: E2E counter of the newest pressure frame used; None before the first.
        next_period: the jets begin to move at the next sampling instant, not when the command arrives.
    """

    flow_m2_per_s: float
    mode: Mode
    enable: bool
    pressure_counter: int | None
    next_period: bool = False


class EcuStatus(NamedTuple):
    """Health of the controller, and events since power-on.

    Attributes:
        overruns, missed, crc_errors: up to COUNT_LIMIT; the sender limits them.
        bus_off: up to BUS_OFF_LIMIT; the sender limits it.
        bundle_hash: 32 bits, `contract.release.bundle.Bundle.short_hash`.
        refused: pressure frames with a valid CRC that were repeated or out of sequence; up to COUNT_LIMIT.
        not_authentic: pressure frames rejected for their MAC or freshness; up to COUNT_LIMIT.
        tx_errors, rx_errors: the CAN controller's error counters, up to ERROR_LIMIT.
        set_aside: pressures that the controller does not use, bit i for Pressure i; up to SET_ASIDE_LIMIT.
    """

    state: Mode
    reason: Reason
    overruns: int
    missed: int
    crc_errors: int
    bus_off: int
    bundle_hash: int
    refused: int = 0
    not_authentic: int = 0
    tx_errors: int = 0
    rx_errors: int = 0
    set_aside: int = 0
