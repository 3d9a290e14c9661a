"""What disturbs a run, as a line of text each, with its place in s of the run behind an @.

    noise:level=0.5                        every transducer
    stuck:sensor=base_7@2..5               one of them, from 2 s until before 5 s
    ecu:drop:probability=0.3               in a node's port: `firmware_sim.bench.run_faults`
    wire_errors:bit_error_rate=1,node=ecu@2..2.01
    reset@4                                once
    reynolds=700                           the flow is not the one of the training
    body:length=1                          nor the vehicle
    gust:amplitude=0.1,period=20

A disturbance is plain data; `disturbing.py` puts all of them to work. Sensors are the bundle's: no other one is read.
Levels are in global deviations of pressure (`firmware_sim.bench.sensor_faults`).
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from math import floor, inf
from typing import Annotated, Final, Literal, Self, TypeVar

from can_bridge.bus.faults.fault import Instant, Probability, Span
from can_bridge.bus.faults.text import parse_described, text_of
from contract.config.body import TRUCK_BODY, BodyConfig
from contract.config.rules import Finite, NonNegative, Positive, Rule, require
from contract.config.tree import Config
from contract.errors import ConfigError
from firmware_sim.bench.run_faults import NODES, NodeFault, check_faults, parse_node_fault
from firmware_sim.bench.sensor_faults import Bias, Dead, Drift, Noise, Quantise, SensorDisturbance, Stuck, Swap

T = TypeVar("T", int, float)

Below = Annotated[T, Rule(wording="above 0 and below 0.5", holds=lambda value: 0 < value < 0.5)]
Share = Annotated[T, Rule(wording="above 0 and at most 1", holds=lambda value: 0 < value <= 1)]


@dataclass(frozen=True, kw_only=True)
class WireNoise(Span, section="wire_errors"):
    """Bits that are wrong on the wire: CAN notices, sends again, and counts errors up to bus-off."""

    bit_error_rate: Probability[float]
    """Each bit is wrong with this probability, independent of the others."""
    node: Literal["all", "vehicle", "ecu"] = "all"
    """Only frames that this node sends, or with at=receive only what it hears."""
    at: Literal["send", "receive"] = "send"
    """Wrong for all nodes, or for a receiver alone."""


@dataclass(frozen=True, kw_only=True)
class Reset(Instant, section="reset"):
    """The ECU loses its state, hears nothing while it boots, and starts again.

    What it handed over to its CAN controller goes out. Freshness values of `bus.key` are in lasting memory.
    """

    node: Literal["ecu"] = "ecu"
    boot_s: NonNegative[float] = 0.2
    """The time from the reset to the first step."""


@dataclass(frozen=True, kw_only=True)
class WrongClock(Span, section="clock"):
    """The ECU's clock runs at another rate than the vehicle's, whose periods are the run's, or is set.

    It stamps the frames that the ECU receives and gives it the time; right again at the end of the span, with a jump.
    """

    node: Literal["ecu"] = "ecu"
    ppm: Annotated[float, Rule(wording="above -10^6", holds=lambda value: value > -1e6)] = 0.0
    """The rate by which the clock is fast."""
    offset_s: Finite[float] = 0.0
    """The time by which the clock is ahead at the start of the span."""


@dataclass(frozen=True, kw_only=True)
class NoRequest(Span, section="no_request"):
    """The vehicle takes back its request for control, and raises it again afterwards: what ends a latched fault."""


@dataclass(frozen=True, kw_only=True)
class Reynolds(Span, section="reynolds"):
    """The flow's viscosity is another one than that of `flow.reynolds`; own solver alone."""

    reynolds: Positive[float]
    """U_inf W / nu."""


@dataclass(frozen=True, kw_only=True)
class OtherBody(Span, section="body"):
    """The vehicle is another body than the one the release was made for, with sensors of the same names at its own
    places; own solver alone, for the whole run. The ECU does not know it."""

    length: Finite[float]
    """W, as `body.length`."""
    leading_edge_radius: NonNegative[float] = 0.0
    """W, as `body.leading_edge_radius`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require((self.start_s, self.end_s) == (0.0, inf), self, "start_s", "left out, and its end: a body stays")
        self.instead_of(TRUCK_BODY)

    def instead_of(self, body: BodyConfig) -> BodyConfig:
        """This body, with as many sensors as that one. Raises ConfigError if the solver takes no such body."""
        return replace(body, length=self.length, leading_edge_radius=self.leading_edge_radius)


@dataclass(frozen=True, kw_only=True)
class GustyWind(Span, section="gust"):
    """The wind against the vehicle varies: U(t) = U_inf (1 + amplitude sin(2 pi t / period)); own solver alone.

    `wake.plant.drive` defines that frame of reference. Forces and pressures stay in units of the mean U_inf, as
    the jets do. It ends with the last whole period in the span.
    """

    amplitude: Below[float]
    period: Positive[float]
    """t_c."""


@dataclass(frozen=True, kw_only=True)
class VehiclePoint(Span, section="operating_point"):
    """The vehicle moves at another speed, or in other air, than the ECU was made for.

    Its transducers' pressures and its jets' flow scale accordingly. Clocks stay: a control period is as many t_c as
    before, and the wake behaves as at `flow.reynolds`.
    """

    speed: Annotated[float | None, Rule(wording="positive", holds=lambda value: value > 0, or_none=True)] = None
    """m/s; that of `operating_point.speed` without."""
    density: Annotated[float | None, Rule(wording="positive", holds=lambda value: value > 0, or_none=True)] = None
    """kg/m3, likewise."""


@dataclass(frozen=True, kw_only=True)
class ActionLimit(Span, section="action_limit"):
    """The jets saturate below what the ECU takes for their limit."""

    action_limit: Share[float]
    """Share of `flow.action_limit` that they reach."""


@dataclass(frozen=True, kw_only=True)
class StuckJets(Span, section="stuck_jets"):
    """The jets' actuator stands still, whatever it is commanded."""

    stuck_jets: Annotated[Finite[float], Rule(wording="between -1 and 1", holds=lambda value: -1 <= value <= 1)]
    """The share of `flow.action_limit` at which the jets stand; 0 is shut."""


@dataclass(frozen=True, kw_only=True)
class SpeedScale(Span, section="speed_scale"):
    """The speed that the vehicle sends is wrong by a factor."""

    speed_scale: NonNegative[float]


@dataclass(frozen=True, kw_only=True)
class SpeedLate(Span, section="speed_late"):
    """The speed that the vehicle sends is the one of so long before, without showing its age."""

    speed_late: NonNegative[float]
    """s; rounded to whole control periods."""


@dataclass(frozen=True, kw_only=True)
class SpeedFrozen(Span, section="speed_frozen"):
    """The speed that the vehicle sends stays what it is at the start of the span."""


@dataclass(frozen=True, kw_only=True)
class NoSpeed(Span, section="no_speed"):
    """The vehicle sends no speed."""


@dataclass(frozen=True, kw_only=True)
class Density(Span, section="density"):
    """The air has another density than the ECU was made for: pressures scale with it, the jets' flow does not."""

    density: Positive[float]
    """kg/m3."""
    stated: bool = False
    """Whether the vehicle knows it, and sends it with its speed."""


KINDS: Final[dict[str, type[Span]]] = {
    kind.section: kind
    for kind in (
        *(Noise, Bias, Drift, Stuck, Dead, Swap, Quantise),
        *(WireNoise, Reset, WrongClock, NoRequest),
        *(Reynolds, OtherBody, GustyWind, VehiclePoint, ActionLimit, StuckJets),
        *(SpeedScale, SpeedLate, SpeedFrozen, NoSpeed, Density),
    )
}
"""The kinds by the name that texts use; what begins with the name of a node is a `NodeFault`."""

Disturbance = NodeFault | Span


def parse_disturbance(text: str) -> Disturbance:
    """What a text describes. Raises ConfigError naming the text, and what is not known, missing, of another type or out
    of its bounds."""
    node, colon, _ = text.partition(":")
    if colon and node in NODES:
        return parse_node_fault(text)
    return parse_described(text, KINDS, "disturbance")


@dataclass(frozen=True, kw_only=True)
class Disturbances:
    """Everything that disturbs a run; comparable, picklable, and read back from its own texts.

    Attributes:
        items: in the order given, each with draws of its own by its place. Of several on the sensors the first is next
            to the wall, of several in a port next to the wire; of several of the flow or the vehicle that act at once
            the last one counts.
    """

    items: tuple[Disturbance, ...] = field(default=())

    @classmethod
    def parse(cls, texts: Iterable[str]) -> Self:
        """See `parse_disturbance`."""
        return cls(items=tuple(map(parse_disturbance, texts)))

    @property
    def texts(self) -> tuple[str, ...]:
        """Texts of the items, which `parse` takes."""
        return tuple(one.text if isinstance(one, NodeFault) else text_of(one) for one in self.items)

    @property
    def other_body(self) -> OtherBody | None:
        """What the vehicle is in place of the release's, if it is another."""
        return next((one for one in reversed(self.items) if isinstance(one, OtherBody)), None)

    def plant(self, config: Config) -> Config:
        """The settings with the body that the plant has."""
        other = self.other_body
        return config if other is None else replace(config, body=other.instead_of(config.body))

    def check(self, config: Config, sensors: tuple[str, ...], *, duration_s: float) -> None:
        """Raises ConfigError for what could not act in a run of this length with these sensors in use."""
        check_faults([one for one in self.items if isinstance(one, NodeFault)], config.bus, duration_s=duration_s)
        for one, text in zip(self.items, self.texts, strict=True):
            if isinstance(one, NodeFault):
                continue
            if one.start_s >= duration_s:
                raise ConfigError(f"disturbance {text!r}: begins when the run has ended, after {duration_s:g} s")
            for name in one.named if isinstance(one, SensorDisturbance) else ():
                if name not in sensors:
                    raise ConfigError(
                        f"disturbance {text!r}: {name} is not in use; the sensors are {', '.join(sensors)}"
                    )
            if isinstance(one, GustyWind):
                whole_cycles(one, config.operating_point.convective_time)


def whole_cycles(gust: GustyWind, convective_time: float) -> float:
    """Periods of the gust in its span; raises ConfigError if there is none."""
    if gust.end_s == inf:
        return inf
    cycles = floor((gust.end_s - gust.start_s) / (gust.period * convective_time) + 1e-9)
    if cycles < 1:
        raise ConfigError(
            f"disturbance {text_of(gust)!r}: lasts {gust.end_s - gust.start_s:g} s, must be at least its period, "
            f"{gust.period * convective_time:g} s"
        )
    return cycles
