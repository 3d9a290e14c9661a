"""The settings of the bus, the ECU and the simulated vehicle."""

from dataclasses import dataclass, field
from typing import Annotated, Final, Literal

from contract.config.diagnosis import DiagnosisConfig
from contract.config.notes import BIT_RATE, FLOW_RATE, FRAMES, MILLISECONDS, PERIODS, STEPS, Unit, ours, paper, standard
from contract.config.rules import AtLeastOne, Fraction, NonNegative, Positive, Settings, require, within

SIMULATED: Final = "simulated"
"""Name of the interface to stillwake's simulated bus."""
LARGEST_NOMINAL_BITRATE: Final = 1_000_000
LARGEST_DATA_BITRATE: Final = 8_000_000
"""Largest bit rates of the arbitration phase and the data phase, in bit/s. Transceivers that follow ISO 11898-2:2016
and CiA 601-4 allow no higher rates."""
_CAN_FD: Final = standard("SAE J2284-4", "CAN FD in vehicles, 500 kbit/s with data at 2 Mbit/s")
_DELAY: Final = within(0, 10_000, "a longer delay exceeds every horizon")
_E2E: Final = "explanation/protection.md"
_GATE: Final = "explanation/what-shuts-the-jets.md#the-command-gate"
_LIES: Final = "explanation/what-shuts-the-jets.md#sensors-that-read-wrongly"
_HELPS: Final = "explanation/what-shuts-the-jets.md#control-that-does-not-help"


@dataclass(frozen=True, kw_only=True)
class E2eConfig(Settings, section="bus.e2e", source=ours("AUTOSAR E2E leaves these numbers to the project", page=_E2E)):
    """The conditions under which a receiver treats the frames of an E2E-protected message as a valid stream."""

    max_delta: Annotated[
        int, within(1, 127, "half the counter's period"), FRAMES, ours("lost frames that the ECU bridges", page=_GATE)
    ] = 4
    """A frame is accepted if its counter exceeds the last frame's counter by at most this number. The default 4 allows
    a loss of three frames in a row; the ECU's fail-safe bridges the same number."""
    window: Annotated[AtLeastOne[int], FRAMES] = 5
    """Number of latest check results that together decide whether a stream is valid."""
    min_ok: Annotated[int, FRAMES] = 2
    """Smallest number of passed checks in the window for a valid stream."""
    max_errors: Annotated[int, FRAMES] = 2
    """Largest number of CRC errors in the window for a valid stream."""

    def _check_together(self) -> None:
        require(1 <= self.min_ok <= self.window, self, "min_ok", "in 1..window")
        require(0 <= self.max_errors < self.window, self, "max_errors", "in 0..window-1")


@dataclass(frozen=True, kw_only=True)
class BackgroundConfig(
    Settings, section="bus.background", source=ours("a bus without other nodes", page="explanation/simulated-bus.md")
):
    """The traffic of other nodes on the simulated bus. Without this traffic, frames hardly ever wait for the bus."""

    load: Fraction[float] = 0.0
    """Share of the bus time that generated periodic messages take, including stuff bits."""
    dbc: str = ""
    """DBC file whose messages replace the generated messages. Each message has random contents and the file's cycle
    time (`GenMsgCycleTime`)."""
    seed: Annotated[NonNegative[int], ours("an arbitrary number")] = 0
    """Random seed of the background messages' identifiers, phases and contents."""

    def _check_together(self) -> None:
        require(not (self.dbc and self.load), self, "load", "0 if bus.background.dbc is given")


@dataclass(frozen=True, kw_only=True)
class BusConfig(Settings, source=ours("needs no hardware", page="explanation/simulated-bus.md")):
    """The CAN bus. Bit rates are in bit/s."""

    interface: str = SIMULATED
    """Kind of CAN interface. `simulated` is stillwake's own bus in virtual time. The other interfaces run in real time:
    `virtual`, `udp_multicast`, `slcan`, `socketcan` or another interface of python-can. With `python-can`,
    `bus.channel` names the section of python-can's own configuration that selects the interface."""
    channel: Annotated[str, ours("stillwake's own name")] = "stillwake"
    """Name (virtual), multicast address (udp_multicast, e.g. 239.74.163.2), serial port (slcan) or network device
    (socketcan, e.g. can0) of the bus. The simulated bus does not use this setting."""
    nominal_bitrate: Annotated[int, within(1, LARGEST_NOMINAL_BITRATE, "CAN's highest"), BIT_RATE, _CAN_FD] = 500_000
    """Bit rate of the arbitration phase, and of whole classic CAN frames."""
    data_bitrate: Annotated[Positive[int], BIT_RATE, _CAN_FD] = 2_000_000
    """Bit rate of the data phase of CAN FD frames."""
    frames: Annotated[Literal["fd", "classic"], ours("the stronger check", page=_E2E)] = "fd"
    """Set of messages: `fd` for CAN FD; `classic` for classic CAN, with eight data bytes, coarser pressures and a
    weaker CRC."""
    key: Annotated[str, ours("each user makes a secret key", page=_E2E)] = ""
    """File with a 128-bit key. With a key, both nodes authenticate every frame (AUTOSAR SecOC) and refuse
    unauthenticated frames. Only CAN FD frames have space for the authenticator."""
    background: BackgroundConfig = field(default_factory=BackgroundConfig)
    e2e: E2eConfig = field(default_factory=E2eConfig)
    diagnosis: DiagnosisConfig = field(default_factory=DiagnosisConfig)

    def _check_together(self) -> None:
        for name, article in (("interface", "an"), ("channel", "a")):
            value = getattr(self, name)
            require(value.isprintable() and bool(value.strip()), self, name, f"the name of {article} {name}")
        if self.frames == "classic":
            room = "empty with bus.frames = classic: its eight bytes have no space for a MAC"
            require(not self.key, self, "key", room)
            counter = "in 1..7 with bus.frames = classic, whose counter has 4 bits"
            require(self.e2e.max_delta < 8, self.e2e, "max_delta", counter)
        else:
            faster = f"in nominal_bitrate..{LARGEST_DATA_BITRATE}: the data phase of CAN FD must not be slower"
            fits = self.nominal_bitrate <= self.data_bitrate <= LARGEST_DATA_BITRATE
            require(fits, self, "data_bitrate", faster)


@dataclass(frozen=True, kw_only=True)
class SensorCheckConfig(
    Settings, section="ecu.sensor_check", source=ours("above the figures of healthy sensors", page=_LIES)
):
    """The thresholds of the ECU's check of its pressure sensors. Levels are ratios of variances. The values of healthy
    sensors are from the whole shipped recording (docs/explanation/what-shuts-the-jets.md)."""

    enabled: Annotated[bool, ours("a sensor that reads wrongly costs most of the drag reduction", page=_LIES)] = True
    """Whether the ECU checks the pressures with the bundle's estimator, and continues without a faulty sensor."""
    liar_level: Positive[float] = 14.0
    """Ratio at which the ECU no longer uses a sensor. The ratio is the mean squared deviation of this sensor from the
    other sensors' estimate, divided by the mean squared disagreement of the other sensors. Healthy sensors reach 13."""
    bias_level: Positive[float] = 20.0
    """Limit like `liar_level`, but for deviations averaged over two shedding cycles. These averages show small biases
    and drifts. Healthy sensors reach 14, except in one episode, where they reach 22."""
    swap_level: Positive[float] = 2.5
    """Ratio at which two sensors are treated as exchanged: the disagreement among the received pressures, divided by
    the disagreement after the two readings are exchanged. Healthy sensors reach 0.9."""
    doubt_level: Positive[float] = 16.0
    """A period is doubtful if the pressures disagree by this level, and no single sensor explains the disagreement.
    Once the ECU no longer uses a sensor, the limit is twice this value. Healthy sensors reach 14 with forcing outside
    the range of the training data."""
    doubt_periods: Annotated[AtLeastOne[int], PERIODS, ours("a shedding cycle")] = 25
    """Count of doubtful periods at which the jets go to zero and the fault latches. A period that is not doubtful
    subtracts 1."""
    flat_periods: Annotated[AtLeastOne[int], PERIODS, ours("longer than healthy readings repeat", page=_LIES)] = 10
    """Number of consecutive periods with bit-identical readings after which a sensor counts as stuck."""


@dataclass(frozen=True, kw_only=True)
class BenefitCheckConfig(
    Settings, section="ecu.benefit_check", source=ours("between useful and harmful control", page=_HELPS)
):
    """The thresholds with which the ECU decides whether control helps (docs/explanation/what-shuts-the-jets.md)."""

    enabled: Annotated[bool, ours("outside its design conditions a controller can raise drag", page=_HELPS)] = True
    """Whether the ECU compares base pressures with and without control, and shuts the jets if control does not help."""
    mean_periods: Annotated[AtLeastOne[int], PERIODS, ours("two shedding cycles")] = 50
    """Number of periods over which pressures are averaged, with and without control."""
    wake_periods: Annotated[AtLeastOne[int], PERIODS, ours("until shedding is restored", page=_HELPS)] = 150
    """Number of periods with the jets shut after which the wake counts as the wake without control."""
    first_period: Annotated[AtLeastOne[int], PERIODS, ours("the wake needs a cycle to respond", page=_HELPS)] = 60
    """First period of control that is judged. In earlier periods the wake has not yet responded."""
    least_gain: NonNegative[float] = 0.04
    """Smallest share of the base suction that control must remove to count as helping."""
    most_swing: Positive[float] = 1.15
    """Largest mean difference between mirrored sensors at which control counts as helping, relative to the mean
    difference without control."""
    doubt_periods: Annotated[AtLeastOne[int], PERIODS, ours("a shedding cycle")] = 25
    """Count at which the jets are shut for a test. A period in which control did not help adds 1, and a period in which
    control helped subtracts 1. The fault latches if the test fails."""

    def _check_together(self) -> None:
        require(self.least_gain < 1.0, self, "least_gain", "below 1")


@dataclass(frozen=True, kw_only=True)
class SpeedConfig(
    Settings, section="ecu.speed", source=ours("within the limits of a vehicle", page="explanation/other-speeds.md")
):
    """The conditions under which the ECU accepts the vehicle's speed, for a release that covers a range of speeds."""

    oldest_ms: Annotated[Positive[float], MILLISECONDS] = 500.0
    """Largest age at which a measured speed is used in a control step, if no newer speed arrives."""
    most_acceleration: Annotated[Positive[float], Unit("m/s2")] = 15.0
    """Largest possible acceleration. A speed is rejected if reaching it would need a larger acceleration."""
    margin: Annotated[Fraction[float], ours("a 10 % wind and a gust", page="explanation/other-speeds.md")] = 0.12
    """The jets are shut if the vehicle's speed is outside the release's range by more than this share of the range's
    nearest end. A smaller deviation is allowed, because the air speed may be in range; the ECU then uses that end. The
    jets restart when the speed is in the range."""
    most_correction: Annotated[Fraction[float], ours("a 10 % wind", page="explanation/other-speeds.md")] = 0.12
    """Largest share by which the ECU corrects the speed on the bus with an estimate of the air speed. The speed on the
    bus lacks the wind. With 0 the ECU uses the speed on the bus."""


@dataclass(frozen=True, kw_only=True)
class EcuConfig(Settings, source=ours("the paper has no ECU", page=_GATE)):
    """The timing and the fail-safe behaviour of the ECU."""

    compute_time_ms: Annotated[NonNegative[float], MILLISECONDS, ours("an assumed share of the period of 20 ms")] = 8.0
    """Time that the virtual ECU takes for a control step, from the step's start to the command. This time is an assumed
    share of the budget, not a measurement; reports also show the measured latency."""
    hold_periods: Annotated[NonNegative[int], PERIODS] = 1
    """Number of consecutive periods without usable pressures during which the ECU repeats the last command."""
    decay_periods: Annotated[NonNegative[int], PERIODS] = 2
    """Number of further periods without usable pressures, each of which halves the command. After them the command is
    zero and the fault latches."""
    rearm_frames: Annotated[AtLeastOne[int], FRAMES, ours("a tenth of a second", page=_GATE)] = 5
    """Number of consecutive good frames that the ECU needs before a rising edge of the request can clear a latched
    fault."""
    pressure_age: Annotated[Positive[float], PERIODS] = 1.5
    """Largest age at which pressures may be used for planning, counted from sampling to control step. The default
    allows one period of waiting for the step, and half a period of transmission. A delay of 20 or 40 ms doubles the
    side force."""
    loss_window: Annotated[AtLeastOne[int], PERIODS, ours("a second", page=_GATE)] = 50
    """Number of latest periods with a request in which periods without usable pressures are counted."""
    loss_limit: Annotated[int, PERIODS, ours("four sigma above a random loss of 25 %", page=_GATE)] = 25
    """The jets go to zero and the fault latches if this number of the latest `ecu.loss_window` periods had no usable
    pressures. A controller that gets at most every second sample does not control the flow."""
    deadline_misses: Annotated[AtLeastOne[int], STEPS] = 3
    """The ECU switches itself off if this number of the latest `ecu.deadline_window` steps were mistimed: the
    accumulated lateness or earliness reached half a period. A number above `ecu.deadline_window` disables the check."""
    deadline_window: Annotated[AtLeastOne[int], STEPS] = 10
    """Number of latest steps in which mistimed steps are counted."""
    plan_ahead: Annotated[bool, ours("drag falls more", page="reference/results.md#what-limits-the-reduction")] = True
    """Whether the ECU plans for the next control period. If so, the jets begin to move at the start of that period, and
    computing may take the whole present period. If not, the jets move as soon as the command arrives."""
    step_offset_ms: Annotated[
        NonNegative[float], MILLISECONDS, ours("a fifth of a period covers jitter", page="how-to/run-on-an-ecu.md")
    ] = 4.0
    """Time from the expected arrival of a pressure frame to the control step that uses the frame. Pressures that are
    late by less than this time are still used in their own period. The plan is for the next period, so waiting costs
    nothing if the step is finished before the present period ends."""
    delay_steps: Annotated[int, _DELAY, PERIODS, paper("appendix B", "the case without delay")] = 0
    """Actuator delay that the controller compensates."""
    sensor_check: SensorCheckConfig = field(default_factory=SensorCheckConfig)
    benefit_check: BenefitCheckConfig = field(default_factory=BenefitCheckConfig)
    speed: SpeedConfig = field(default_factory=SpeedConfig)
    command_step: Annotated[Positive[float], FLOW_RATE, ours("half the full range", page=_GATE)] = 0.075
    """Largest change of the jet command per period that the ECU's command gate permits. The default is three times the
    largest change of the training waveform at full amplitude."""

    def _check_together(self) -> None:
        require(1 <= self.loss_limit <= self.loss_window, self, "loss_limit", "in 1..loss_window")

    @property
    def frozen_actions(self) -> int:
        """Number of periods whose action is fixed before planning: the actuator delay, plus 1 when planning ahead."""
        return self.delay_steps + self.plan_ahead


@dataclass(frozen=True, kw_only=True)
class VehicleConfig(Settings, source=ours("the same as in the ECU", page=_GATE)):
    """The simulated vehicle."""

    actuator_delay: Annotated[int, _DELAY, PERIODS, paper("appendix B", "the case without delay")] = 0
    """Delay of the jets after a command. The controller assumes `ecu.delay_steps`."""
    action_step: Annotated[Positive[float], FLOW_RATE] = 0.075
    """Largest change of the action per period that the jets' driver permits, except for shutting the jets. The default
    equals the default of `ecu.command_step`; the vehicle enforces its limit independently."""
    loss_window: Annotated[AtLeastOne[int], PERIODS] = 50
    """Number of latest periods under control in which periods without a usable command are counted."""
    loss_limit: Annotated[int, PERIODS] = 25
    """The vehicle shuts its jets and withdraws its enable request if this number of the latest `vehicle.loss_window`
    periods had no usable command. Requests resume only after a period in which the vehicle wants no control. The limit
    is like `ecu.loss_limit`: jets that follow at most every second command are not under control."""

    def _check_together(self) -> None:
        require(1 <= self.loss_limit <= self.loss_window, self, "loss_limit", "in 1..loss_window")
