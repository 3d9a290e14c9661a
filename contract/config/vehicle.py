"""Settings of the bus, the ECU and the vehicle around it."""

from dataclasses import dataclass, field
from typing import Annotated, Final, Literal

from contract.config.diagnosis import DiagnosisConfig
from contract.config.rules import (
    BIT_RATE,
    FLOW_RATE,
    FRAMES,
    MILLISECONDS,
    PERIODS,
    STEPS,
    AtLeastOne,
    Fraction,
    NonNegative,
    Positive,
    Settings,
    Unit,
    ours,
    paper,
    require,
    standard,
    within,
)

LARGEST_NOMINAL_BITRATE: Final = 1_000_000
LARGEST_DATA_BITRATE: Final = 8_000_000
"""Bit rates of arbitration and of the data phase that ISO 11898-2:2016 and CiA 601-4 specify transceivers up to."""

_CAN_FD: Final = standard("SAE J2284-4", "CAN FD in vehicles, 500 kbit/s with data at 2 Mbit/s")
_DELAY: Final = within(0, 10_000, "more outlast any horizon")
_GATE: Final = "explanation/what-shuts-the-jets.md#the-command-gate"
_LIES: Final = "explanation/what-shuts-the-jets.md#sensors-that-lie"
_HELPS: Final = "explanation/what-shuts-the-jets.md#control-that-does-not-help"


@dataclass(frozen=True, kw_only=True)
class E2eConfig(
    Settings,
    section="bus.e2e",
    source=ours("AUTOSAR E2E leaves these numbers to the project", page="explanation/protection.md"),
):
    """When a receiver of an E2E-protected message trusts the stream."""

    max_delta: Annotated[
        int, within(1, 127, "half the counter's period"), FRAMES, ours("as many lost as the ECU rides out", page=_GATE)
    ] = 4
    """Largest step of the counter that still counts as the next frame: with 4, three may be lost in a row, as
    many as the ECU's fail-safe rides out."""
    window: Annotated[AtLeastOne[int], FRAMES] = 5
    """Latest checks that are judged together."""
    min_ok: Annotated[int, FRAMES] = 2
    """Good ones among them that make a stream valid."""
    max_errors: Annotated[int, FRAMES] = 2
    """Most wrong CRCs among them."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(1 <= self.min_ok <= self.window, self, "min_ok", "in 1..window")
        require(0 <= self.max_errors < self.window, self, "max_errors", "in 0..window-1")


@dataclass(frozen=True, kw_only=True)
class BackgroundConfig(
    Settings, section="bus.background", source=ours("a bus without other nodes", page="explanation/simulated-bus.md")
):
    """Other nodes' traffic on the simulated bus; without it arbitration hardly shows."""

    load: Fraction[float] = 0.0
    """Share of the bus's time that made-up periodic messages take, their stuff bits included."""
    dbc: str = ""
    """File with messages to send at their cycle times (`GenMsgCycleTime`), in place of made-up ones; their contents
    are random."""
    seed: Annotated[NonNegative[int], ours("any would do")] = 0
    """Seed of identifiers, phases and contents."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(not (self.dbc and self.load), self, "load", "0 where bus.background.dbc names the traffic")


SIMULATED: Final = "simulated"
"""The interface of stillwake's own bus."""


@dataclass(frozen=True, kw_only=True)
class BusConfig(Settings, source=ours("needs no hardware", page="explanation/simulated-bus.md")):
    """The CAN bus. Bit rates in bit/s."""

    interface: str = SIMULATED
    """`simulated` is stillwake's own, in virtual time. The others are in real time: `virtual`, `udp_multicast`,
    `slcan`, `socketcan` or another one that python-can knows; `python-can` takes its own configuration, section
    `channel`."""
    channel: Annotated[str, ours("a name of our own")] = "stillwake"
    """A name (virtual), multicast address (udp_multicast, e.g. 239.74.163.2), serial port (slcan) or network
    device (socketcan, e.g. can0). The simulated bus has none."""
    nominal_bitrate: Annotated[int, within(1, LARGEST_NOMINAL_BITRATE, "CAN's highest"), BIT_RATE, _CAN_FD] = 500_000
    """Bit rate of arbitration, and of whole frames of classic CAN."""
    data_bitrate: Annotated[Positive[int], BIT_RATE, _CAN_FD] = 2_000_000
    """Bit rate of the data phase of CAN FD."""
    frames: Annotated[Literal["fd", "classic"], ours("the stronger check", page="explanation/protection.md")] = "fd"
    """CAN FD, or the set of messages for classic CAN: eight bytes, coarser pressures, a weaker check."""
    key: Annotated[str, ours("a key is the user's to make", page="explanation/protection.md")] = ""
    """File with a 128-bit key. With one, both nodes authenticate every frame (AUTOSAR SecOC) and refuse others; CAN FD
    alone has room for it."""
    background: BackgroundConfig = field(default_factory=BackgroundConfig)
    e2e: E2eConfig = field(default_factory=E2eConfig)
    diagnosis: DiagnosisConfig = field(default_factory=DiagnosisConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, article in (("interface", "an"), ("channel", "a")):
            value = getattr(self, name)
            require(value.isprintable() and bool(value.strip()), self, name, f"the name of {article} {name}")
        if self.frames == "classic":
            room = "empty with bus.frames = classic: eight bytes have no room"
            require(not self.key, self, "key", room)
            counter = "in 1..7 with bus.frames = classic, whose counter has 4 bits"
            require(self.e2e.max_delta < 8, self.e2e, "max_delta", counter)
        else:
            faster = f"in nominal_bitrate..{LARGEST_DATA_BITRATE}: the data phase of CAN FD is the faster one"
            fits = self.nominal_bitrate <= self.data_bitrate <= LARGEST_DATA_BITRATE
            require(fits, self, "data_bitrate", faster)


@dataclass(frozen=True, kw_only=True)
class SensorCheckConfig(
    Settings,
    section="ecu.sensor_check",
    source=ours("above what sound sensors reach", page=_LIES),
):
    """When the ECU no longer believes a pressure sensor. Levels are ratios of variances; what sound sensors reach is
    over the whole shipped recording (docs/explanation/what-shuts-the-jets.md)."""

    enabled: Annotated[bool, ours("a liar costs most of the gain", page=_LIES)] = True
    """Check the pressures against each other, with the bundle's estimator, and go on without a sensor that lies."""
    liar_level: Positive[float] = 14.0
    """How much further a sensor is from the estimate by the others than these are from each other, from which on it is
    set aside. Sound sensors reach 8."""
    bias_level: Positive[float] = 20.0
    """The same for averages over two shedding cycles, in which small biases and drifts show. Sound sensors reach 16."""
    swap_level: Positive[float] = 2.5
    """How much better the pressures agree with two of them exchanged, from which on the wiring is in doubt. Sound
    sensors reach 0.9."""
    doubt_level: Positive[float] = 16.0
    """Disagreement among the pressures that no single sensor explains, from which on they are in doubt; twice as much
    once one is set aside. Sound sensors reach 12, under forcing beyond what the model has seen."""
    doubt_periods: Annotated[AtLeastOne[int], PERIODS, ours("a shedding cycle")] = 25
    """Periods in doubt, less those out of it, from which on the jets go to zero and the fault latches."""
    flat_periods: Annotated[AtLeastOne[int], PERIODS, ours("longer than a sound reading rests", page=_LIES)] = 10
    """Periods in a row in which a reading is the same to the last bit, from which on the sensor is stuck."""


@dataclass(frozen=True, kw_only=True)
class BenefitCheckConfig(
    Settings,
    section="ecu.benefit_check",
    source=ours("between useful and harmful control", page=_HELPS),
):
    """When the ECU no longer believes that control helps (docs/explanation/what-shuts-the-jets.md)."""

    enabled: Annotated[bool, ours("off its design a controller can raise drag", page=_HELPS)] = True
    """Compare the base pressure under control with that before, and shut the jets where control does not help."""
    mean_periods: Annotated[AtLeastOne[int], PERIODS, ours("two shedding cycles")] = 50
    """The periods over which pressures are averaged, with and without control."""
    wake_periods: Annotated[AtLeastOne[int], PERIODS, ours("until shedding is as before", page=_HELPS)] = 150
    """The periods with the jets shut after which the wake is taken to be that without control."""
    first_period: Annotated[AtLeastOne[int], PERIODS, ours("the wake needs a cycle to answer", page=_HELPS)] = 60
    """The first period of control that is judged: the wake has to answer before."""
    least_gain: NonNegative[float] = 0.04
    """Share of the base's suction that control has to take away."""
    most_swing: Positive[float] = 1.15
    """Largest difference of mirrored sensors, as a share of that without control."""
    doubt_periods: Annotated[AtLeastOne[int], PERIODS, ours("a shedding cycle")] = 25
    """Periods without such a gain, less those with it, from which on the jets are shut and the fault latches."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.least_gain < 1.0, self, "least_gain", "below 1")


@dataclass(frozen=True, kw_only=True)
class SpeedConfig(
    Settings, section="ecu.speed", source=ours("what a vehicle can do", page="explanation/other-speeds.md")
):
    """When the ECU believes the vehicle's speed, with a release that serves a range of speeds."""

    oldest_ms: Annotated[Positive[float], MILLISECONDS] = 500.0
    """The longest time from measuring a speed to the control step. The last speed stays in force for so long where no
    other one comes."""
    most_acceleration: Annotated[Positive[float], Unit("m/s2")] = 15.0
    """The largest acceleration of a vehicle: a speed that is further from the last one is not believed."""
    margin: Annotated[Fraction[float], ours("a wind of a tenth and a gust", page="explanation/other-speeds.md")] = 0.12
    """Share by which the speed may leave the release's range before the jets are shut: the air's may still be in it.
    Until then it is taken for the end of the range. They come back when it is within the range."""


@dataclass(frozen=True, kw_only=True)
class EcuConfig(Settings, source=ours("our ECU; the paper has none", page=_GATE)):
    """Timing and fail-safe behaviour of the ECU."""

    compute_time_ms: Annotated[NonNegative[float], MILLISECONDS, ours("a stated share of the 20 ms of a period")] = 8.0
    """Time between frame and command that the virtual ECU charges for its control step. It is a stated
    budget share, not a measurement; measured latency is reported next to it."""
    hold_periods: Annotated[NonNegative[int], PERIODS] = 1
    """Missed periods during which the last command is held."""
    decay_periods: Annotated[NonNegative[int], PERIODS] = 2
    """Missed periods after that during which the command is halved each period, before zero and latch."""
    rearm_frames: Annotated[AtLeastOne[int], FRAMES, ours("a tenth of a second", page=_GATE)] = 5
    """Consecutive good frames, together with an enable edge, that end a latched fault."""
    pressure_age: Annotated[Positive[float], PERIODS] = 1.5
    """Oldest pressures, from sampling to control step, that may be planned on: one period of waiting for the step, and
    half a one for the way. Pressures 20 ms late cost the loop little; with 40 ms the side force grows."""
    loss_window: Annotated[AtLeastOne[int], PERIODS, ours("a second", page=_GATE)] = 50
    """Latest periods under control that are judged together by `ecu.loss_limit`."""
    loss_limit: Annotated[int, PERIODS, ours("four deviations above a quarter lost at random", page=_GATE)] = 25
    """Periods without usable pressures among them, in a row or not, from which on the jets go to zero and the fault
    latches: a controller that sees every other pressure at best is not in control."""
    deadline_misses: Annotated[AtLeastOne[int], STEPS] = 3
    """Steps that came a period or more late, or too early by half a one, among the latest `ecu.deadline_window`, from
    which on the ECU switches itself off. More than the window: never."""
    deadline_window: Annotated[AtLeastOne[int], STEPS] = 10
    """Latest steps that are judged together by `ecu.deadline_misses`."""
    plan_ahead: Annotated[bool, ours("takes off more drag", page="reference/results.md#what-limits-the-reduction")] = (
        True
    )
    """Plan for the next control period: the jets begin to move at its start, wherever in this one the command arrives,
    and computing may take all of this one. Without, they move as soon as the command is there."""
    step_offset_ms: Annotated[
        NonNegative[float], MILLISECONDS, ours("a fifth of a period for jitter", page="how-to/run-on-an-ecu.md")
    ] = 4.0
    """The real time from the expected arrival of a pressure frame to the control step that uses it. Pressures that come
    later by less than this are still used in their own period; the plan is made a period ahead, so that the waiting
    costs nothing while the step is done before the period's end."""
    delay_steps: Annotated[int, _DELAY, PERIODS, paper("appendix B", "the case without delay")] = 0
    """Actuator delay in control periods that the controller compensates (paper, appendix B)."""
    sensor_check: SensorCheckConfig = field(default_factory=SensorCheckConfig)
    benefit_check: BenefitCheckConfig = field(default_factory=BenefitCheckConfig)
    speed: SpeedConfig = field(default_factory=SpeedConfig)
    command_step: Annotated[Positive[float], FLOW_RATE, ours("half the full range", page=_GATE)] = 0.075
    """Largest change of the jet command in one period that the command gate lets pass, in U_inf W: three times what
    the training waveform does at full amplitude."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(1 <= self.loss_limit <= self.loss_window, self, "loss_limit", "in 1..loss_window")

    @property
    def frozen_actions(self) -> int:
        """Periods whose action is settled when the ECU plans: the actuator's delay, and this one if it plans ahead."""
        return self.delay_steps + self.plan_ahead


@dataclass(frozen=True, kw_only=True)
class VehicleConfig(Settings, source=ours("the same as the ECU's", page=_GATE)):
    """The simulated vehicle."""

    actuator_delay: Annotated[int, _DELAY, PERIODS, paper("appendix B", "the case without delay")] = 0
    """Control periods by which the jets follow a command late. `ecu.delay_steps` is what the controller assumes."""
    action_step: Annotated[Positive[float], FLOW_RATE] = 0.075
    """Largest change of the jets' action in one period that their driver makes, in U_inf W, shutting apart: the same as
    `ecu.command_step`, and kept by the vehicle itself."""
    loss_window: Annotated[AtLeastOne[int], PERIODS] = 50
    """Latest periods under control that are judged together by `vehicle.loss_limit`: a second, as by the ECU."""
    loss_limit: Annotated[int, PERIODS] = 25
    """Periods without a usable command among them from which on the vehicle shuts its jets and withdraws its request,
    until its own request was low once. Like `ecu.loss_limit`, for the other direction: jets that follow every other
    command at best are not under control."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(1 <= self.loss_limit <= self.loss_window, self, "loss_limit", "in 1..loss_window")
