"""The disturbances of a run, each described by a line of text. After an @ is the time span, in s from the run's start.

    noise:level=0.5                        on every transducer
    stuck:sensor=base_7@2..5               on one transducer, from 2 s to just before 5 s
    ecu:drop:probability=0.3               on the frames of one node: NODE:FAULT, see `can_bridge.bus.faults.text`
    wire_errors:bit_error_rate=1,node=ecu@2..2.01
    reset@4                                once, at 4 s of the run
    reynolds=700                           a Reynolds number other than in the training
    body:length=1                          a body other than in the training
    gust:amplitude=0.1,period=20

The classes here only describe disturbances; `disturbing.py` applies them. A disturbance can name only sensors of the
bundle, because the ECU reads no others. Levels are in global deviations of pressure (`sensor_faults.py`).
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from math import floor, inf
from typing import Annotated, Final, Literal, Self, TypeVar

from can_bridge.bus.faults.fault import BusFault, Instant, Probability, Span
from can_bridge.bus.faults.frame_faults import FlipBits, StuckAt
from can_bridge.bus.faults.node_faults import ClockDrift, Disconnect
from can_bridge.bus.faults.text import parse_described, parse_fault, text_of
from contract.config.body import TRUCK_BODY, BodyConfig
from contract.config.operating_point import OperatingPoint
from contract.config.rules import Finite, NonNegative, Positive, Rule, require
from contract.config.tree import Config
from contract.errors import ConfigError
from firmware_sim.bench.sensor_faults import Bias, Dead, Drift, Noise, Quantise, SensorDisturbance, Stuck, Swap

T = TypeVar("T", int, float)
NODES: Final = ("vehicle", "ecu")
Below = Annotated[T, Rule(wording="above 0 and below 0.5", holds=lambda value: 0 < value < 0.5)]
Share = Annotated[T, Rule(wording="above 0 and at most 1", holds=lambda value: 0 < value <= 1)]


@dataclass(frozen=True, kw_only=True)
class NodeFault:
    """A fault that acts on the frames at the bus port of one node."""

    text: str
    node: str
    fault: BusFault


@dataclass(frozen=True, kw_only=True)
class WireNoise(Span, section="wire_errors"):
    """A span in which each bit on the bus is wrong with the probability `bit_error_rate`, independently of the others.
    CAN detects errors, sends the frame again, and counts errors until bus-off. With `at` send, the errors are in frames
    that `node` sends, so that all nodes see them; with receive, only `node` sees them."""

    bit_error_rate: Probability
    node: Literal["all", "vehicle", "ecu"] = "all"
    at: Literal["send", "receive"] = "send"


@dataclass(frozen=True, kw_only=True)
class Reset(Instant, section="reset"):
    """A reset of the ECU. It loses its state, but not the freshness values (`bus.key`) in its non-volatile memory. It
    receives nothing while it boots for `boot_s` s, and starts again. Frames in its CAN controller are still sent."""

    node: Literal["ecu"] = "ecu"
    boot_s: NonNegative[float] = 0.2


@dataclass(frozen=True, kw_only=True)
class WrongClock(ClockDrift, section="clock"):
    """An ECU clock whose rate or time differs from the vehicle's clock. The vehicle's clock times the periods. The
    ECU's clock gives the times of steps and received frames; at the span's end it jumps to the correct time."""

    node: Literal["ecu"] = "ecu"


@dataclass(frozen=True, kw_only=True)
class NoRequest(Span, section="no_request"):
    """A span without a request for control; the new request after the span clears a latched fault of the ECU."""


@dataclass(frozen=True, kw_only=True)
class Reynolds(Span, section="reynolds"):
    """A flow whose Reynolds number U_inf W / nu differs from `flow.reynolds`."""

    reynolds: Positive[float]


@dataclass(frozen=True, kw_only=True)
class OtherBody(Span, section="body"):
    """A body in the built-in solver for a whole run; the ECU is not informed. The fields, in W, replace the settings of
    the same names in `body`. The sensors keep their names, but lie on this body."""

    length: Finite[float]
    leading_edge_radius: NonNegative[float] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require((self.start_s, self.end_s) == (0.0, inf), self, "start_s", "left out, like the end: a body stays")
        self.instead_of(TRUCK_BODY)

    def instead_of(self, body: BodyConfig) -> BodyConfig:
        """Return `body` with these dimensions. Raises ConfigError if the solver does not accept the result."""
        return replace(body, length=self.length, leading_edge_radius=self.leading_edge_radius)


@dataclass(frozen=True, kw_only=True)
class GustyWind(Span, section="gust"):
    """A gust: the wind against the vehicle is `U(t) = U_inf * (1 + amplitude * sin(2 * pi * t / period))`.

    `wake.plant.drive` defines the frame of reference; the period is in t_c. Forces, pressures and jet actions remain in
    units of the mean U_inf. The gust lasts for the largest number of whole periods that fits into the span.
    """

    amplitude: Below[float]
    period: Positive[float]


@dataclass(frozen=True, kw_only=True)
class VehiclePoint(Span, section="operating_point"):
    """A speed in m/s or air density in kg/m3 that the ECU does not know. None means the value of `operating_point`.
    Both scale the pressures in Pa. The speed also scales the jets' flow rates in m2/s, but not the Reynolds number."""

    speed: float | None = None
    density: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.speed is not None or self.density is not None, self, "speed", "a number, unless density is given")
        self.instead_of(OperatingPoint())

    def instead_of(self, point: OperatingPoint) -> OperatingPoint:
        """Return `point` with these values. Raises ConfigError if a value is not allowed in an operating point."""
        given = {"speed": self.speed, "density": self.density}
        return replace(point, **{name: value for name, value in given.items() if value is not None})


@dataclass(frozen=True, kw_only=True)
class ActionLimit(Span, section="action_limit"):
    """A limit at which the jets saturate, as a share of `flow.action_limit`, the limit that the ECU assumes."""

    action_limit: Share[float]


@dataclass(frozen=True, kw_only=True)
class StuckJets(Span, section="stuck_jets"):
    """A stuck actuator: commands do not change the jets' action, which is given as a share of `flow.action_limit`."""

    stuck_jets: Annotated[Finite[float], Rule(wording="between -1 and 1", holds=lambda value: -1 <= value <= 1)]


@dataclass(frozen=True, kw_only=True)
class SpeedScale(Span, section="speed_scale"):
    """A speed signal that is wrong by a factor."""

    speed_scale: NonNegative[float]


@dataclass(frozen=True, kw_only=True)
class SpeedLate(Span, section="speed_late"):
    """A late speed signal. The delay in s is rounded to whole control periods. No frame contains the delay."""

    speed_late: NonNegative[float]


@dataclass(frozen=True, kw_only=True)
class SpeedFrozen(Span, section="speed_frozen"):
    """A speed signal that keeps the value from the start of the span."""


@dataclass(frozen=True, kw_only=True)
class NoSpeed(Span, section="no_speed"):
    """A missing speed signal."""


@dataclass(frozen=True, kw_only=True)
class Density(Span, section="density"):
    """An air density in kg/m3 that differs from the ECU's settings; if `stated`, the vehicle sends it with its speed.
    It scales the pressures, but not the jets' flow."""

    density: Positive[float]
    stated: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        self.instead_of(OperatingPoint())

    def instead_of(self, point: OperatingPoint) -> OperatingPoint:
        """Return `point` with this density. Raises ConfigError if it is not allowed in an operating point."""
        return replace(point, density=self.density)


KINDS: Final[dict[str, type[Span]]] = {
    kind.section: kind
    for kind in (
        *(Noise, Bias, Drift, Stuck, Dead, Swap, Quantise),
        *(WireNoise, Reset, WrongClock, NoRequest),
        *(Reynolds, OtherBody, GustyWind, VehiclePoint, ActionLimit, StuckJets),
        *(SpeedScale, SpeedLate, SpeedFrozen, NoSpeed, Density),
    )
}
"""Classes of disturbances by the first word of their texts. The text of a `NodeFault` begins with the node's name."""
Disturbance = NodeFault | Span


def parse_disturbance(text: str) -> Disturbance:
    """Return the disturbance that a text describes. Raises ConfigError with the faulty part of an invalid text."""
    node, colon, rest = text.partition(":")
    if not colon or node not in NODES:
        return parse_described(text, KINDS, "disturbance")
    fault = parse_fault(rest)
    if isinstance(fault, Disconnect) and fault.kind == "device_gone":
        raise ConfigError(f"fault {text!r} would end the run with an error; use `{node}:disconnect` for an open wire")
    return NodeFault(text=text, node=node, fault=fault)


@dataclass(frozen=True, kw_only=True)
class Disturbances:
    """The disturbances of a run, in the order given; this object can be compared and pickled. Parsing `texts` gives an
    equal object. Each disturbance has its own random sequence, numbered by its index. Disturbances of the sensors are
    applied in order. In a port, the first disturbance is closest to the bus. Gusts are added, speed factors multiplied.
    If other disturbances of one kind set the same value, the last one applies."""

    items: tuple[Disturbance, ...] = field(default=())

    @classmethod
    def parse(cls, texts: Iterable[str]) -> Self:
        return cls(items=tuple(map(parse_disturbance, texts)))

    @property
    def texts(self) -> tuple[str, ...]:
        return tuple(one.text if isinstance(one, NodeFault) else text_of(one) for one in self.items)

    @property
    def other_body(self) -> OtherBody | None:
        """The body that replaces the release's body; None if no disturbance replaces it."""
        return next((one for one in reversed(self.items) if isinstance(one, OtherBody)), None)

    def plant(self, config: Config) -> Config:
        """Return `config` for the plant, with another body if a disturbance replaces the release's body."""
        other = self.other_body
        return config if other is None else replace(config, body=other.instead_of(config.body))

    def check(self, config: Config, sensors: tuple[str, ...], *, duration_s: float) -> None:
        """Raise ConfigError for a disturbance that could not act in this run with these sensors."""
        for one, text in zip(self.items, self.texts, strict=True):
            noun, span = ("fault", one.fault) if isinstance(one, NodeFault) else ("disturbance", one)
            if span.start_s >= duration_s:
                raise ConfigError(f"{noun} {text!r}: begins after the end of the run ({duration_s:g} s)")
            computes_crc = isinstance(span, FlipBits) and span.before_crc
            if config.bus.key and (computes_crc or (isinstance(span, StuckAt) and span.counter_runs)):
                raise ConfigError(f"fault {text!r} cannot be used with bus.key: its new frames would have no valid MAC")
            for name in one.named if isinstance(one, SensorDisturbance) else ():
                if name not in sensors:
                    used = ", ".join(sensors)
                    raise ConfigError(f"disturbance {text!r}: {name} must be a sensor of the bundle ({used})")
            if isinstance(one, GustyWind):
                whole_cycles(one, config.operating_point.convective_time)


def whole_cycles(gust: GustyWind, convective_time: float) -> float:
    """Return the number of whole gust periods in the gust's span; raises ConfigError if there is none."""
    if gust.end_s == inf:
        return inf
    lasts_s, period_s = gust.end_s - gust.start_s, gust.period * convective_time
    if (cycles := floor(lasts_s / period_s + 1e-9)) < 1:
        least = f"it must last at least one period of {period_s:g} s"
        raise ConfigError(f"disturbance {text_of(gust)!r} lasts {lasts_s:g} s; {least}")
    return cycles
