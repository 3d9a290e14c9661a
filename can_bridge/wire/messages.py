"""The four messages in engineering units. `contract/stillwake.dbc` defines each signal.

Messages are named tuples, because every frame needs a new message, and building a frozen dataclass takes far longer.
"""

from enum import IntEnum
from typing import Final, NamedTuple

SENSORS: Final = 4
"""Number of pressures in a Pressure message, one for each sensor."""

COUNT_LIMIT: Final = 0xFFFF
BUS_OFF_LIMIT: Final = 0xFF
"""Largest values of the event counts and the bus-off count in EcuStatus; larger counts are sent as these values."""

ERROR_LIMIT: Final = 0xFF
"""Largest value that is sent for an error counter of the CAN controller; it is also sent for 256 (bus-off)."""

SET_ASIDE_LIMIT: Final = 0b1111
"""Largest value of `EcuStatus.set_aside`, with the bits of all four pressures."""


class Mode(IntEnum):
    """The state of the control loop in EcuStatus, and the origin of the command in JetCommand."""

    OFF = 0
    WARMUP = 1
    CONTROL = 2
    HOLD = 3
    DECAY = 4
    FAULT = 5


class Reason(IntEnum):
    """The reasons why the jets do not follow the controller."""

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
    """The vehicle's speed is outside the range for which the release was made."""


class Pressure(NamedTuple):
    """The wall pressures of one instant.

    Attributes:
        pressure_pa: pressures relative to the free stream, in Pa, (4,), in the order of the bundle's sensors.
        valid: whether each sensor's own diagnosis found no fault, (4,).
        enable_request: whether the vehicle requests control.
        age_ns: time in ns from sampling until the frame is passed to the bus.
    """

    pressure_pa: tuple[float, ...]
    valid: tuple[bool, ...]
    enable_request: bool
    age_ns: int


class VehicleSpeed(NamedTuple):
    """The vehicle's speed and the density of the air around it.

    Attributes:
        speed_m_per_s: speed, at least 0; None if unknown.
        age_ns: time in ns from the measurement of the speed until the frame is passed to the bus.
        density_kg_per_m3: density, above 0; None if unknown.
    """

    speed_m_per_s: float | None
    age_ns: int
    density_kg_per_m3: float | None = None


class JetCommand(NamedTuple):
    """The flow rate that the jets have to reach by the end of a control period.

    Attributes:
        flow_m2_per_s: flow rate per unit span, positive out of the upper slot and into the lower slot.
        enable: whether the jets may run; if it is False, the jets are shut for any flow.
        pressure_counter: E2E counter of the newest pressure frame that the ECU used; None before the first frame.
        next_period: whether the jets begin to move at the next sampling instant rather than when the command arrives.
    """

    flow_m2_per_s: float
    mode: Mode
    enable: bool
    pressure_counter: int | None
    next_period: bool = False


class EcuStatus(NamedTuple):
    """The health of the controller, and numbers of events since power-on.

    Attributes:
        overruns, missed, crc_errors: numbers of skipped control periods, of periods without usable pressures, and of
            pressure frames with a wrong CRC or length; at most COUNT_LIMIT.
        bus_off: number of times that the CAN controller went bus-off, up to BUS_OFF_LIMIT.
        bundle_hash: first 32 bits of the bundle's hash, `contract.release.bundle.Bundle.short_hash`.
        refused: number of pressure frames with a valid CRC that were repeated or out of sequence, up to COUNT_LIMIT.
        not_authentic: number of pressure frames that were rejected for their MAC or freshness, up to COUNT_LIMIT.
        tx_errors, rx_errors: the CAN controller's error counters, up to ERROR_LIMIT.
        set_aside: bit i is 1 if the controller does not use Pressure i; at most SET_ASIDE_LIMIT.
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
