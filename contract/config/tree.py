"""One tree of settings for every room. Each default is the paper's number unless its comment says otherwise.

Lengths in W, times in t_c, actions a = jet flow rate in U_inf W. A value is checked where it is built, so a
`Config` that exists is valid. `contract.config.loading` reads trees from TOML and applies overrides.
"""

from dataclasses import dataclass, field, fields, replace
from math import isfinite
from typing import Literal

from contract.errors import ConfigError
from contract.operating_point import OperatingPoint

SelectionMethod = Literal["shap", "qr", "greedy", "random", "hand"]
"""How the slim encoder's sensors are chosen (`train.selection`)."""


def _require(holds: bool, owner: object, name: str, rule: str) -> None:
    value = getattr(owner, name)
    if not holds or not isfinite(value):
        raise ConfigError(f"{type(owner).__name__}.{name} = {value!r}: must be {rule}")


@dataclass(frozen=True, kw_only=True)
class FlowConfig:
    """The plant and its clock (paper, section 2.1)."""

    reynolds: float = 500.0
    """U_inf W / nu: the paper's regime, three to four orders of magnitude below a truck on a road."""
    control_period: float = 0.2
    substeps: int = 30
    """Time steps of the solver in a control period: dt = 1/150, set by the jets at full amplitude (ours)."""
    action_limit: float = 0.075

    def __post_init__(self) -> None:
        _require(self.reynolds > 0, self, "reynolds", "positive")
        _require(self.control_period > 0, self, "control_period", "positive")
        _require(self.substeps >= 1, self, "substeps", "at least 1")
        _require(self.action_limit > 0, self, "action_limit", "positive")


@dataclass(frozen=True, kw_only=True)
class ForcingConfig:
    """The open-loop training waveform and the chirp (paper, section 2.1). Frequencies in 1/t_c."""

    base_frequency: float = 0.2
    modulation_cutoff: float = 0.05
    modulation_index: float = 0.25
    envelope_frequency: float = 0.005
    envelope_depth: float = 0.45
    chirp_start: float = 0.1
    chirp_end: float = 0.4
    extended_chirp_start: float = 0.01
    """The extended chirp reaches past what the training waveform explores (paper, appendix A)."""
    extended_chirp_end: float = 0.8
    exploration_time: float = 1.0
    """Correlation time, in t_c, of the noise added to a controller's commands while they are recorded (ours): long
    enough for the wake to answer, a fifth of a shedding cycle."""

    def __post_init__(self) -> None:
        for name in (
            "base_frequency",
            "modulation_cutoff",
            "envelope_frequency",
            "chirp_start",
            "chirp_end",
            "extended_chirp_start",
            "extended_chirp_end",
            "exploration_time",
        ):
            _require(getattr(self, name) > 0, self, name, "positive")
        _require(self.modulation_index >= 0, self, "modulation_index", "non-negative")
        _require(0 <= self.envelope_depth < 1, self, "envelope_depth", "in [0, 1)")


@dataclass(frozen=True, kw_only=True)
class ModelConfig:
    """Shapes of the three networks (paper, table 1)."""

    window: int = 32
    latent: int = 8
    lstm_width: int = 64
    dynamics_width: int = 256
    decoder_width: int = 128
    decoder_blocks: int = 2
    dropout: float = 0.25
    slim_dynamics_width: int | None = None
    """Of the dynamics that the controller rolls out, distilled from the trained ones; None deploys those (ours)."""
    slim_decoder_width: int | None = None

    def __post_init__(self) -> None:
        for name in ("window", "latent", "lstm_width", "dynamics_width", "decoder_width", "decoder_blocks"):
            _require(getattr(self, name) >= 1, self, name, "at least 1")
        for name in ("slim_dynamics_width", "slim_decoder_width"):
            if getattr(self, name) is not None:
                _require(getattr(self, name) >= 1, self, name, "at least 1")
        _require(0 <= self.dropout < 1, self, "dropout", "in [0, 1)")

    @property
    def slim(self) -> "ModelConfig":
        """Shapes of the networks that are deployed. Dropout is left out: the student's teacher makes no noise."""
        return replace(
            self,
            dynamics_width=self.slim_dynamics_width or self.dynamics_width,
            decoder_width=self.slim_decoder_width or self.decoder_width,
            dropout=0.0,
        )

    @property
    def is_slimmed(self) -> bool:
        """Whether dynamics and decoder are distilled too, and not the encoder alone."""
        return self.slim_dynamics_width is not None or self.slim_decoder_width is not None


@dataclass(frozen=True, kw_only=True)
class FinishConfig:
    """Last passes of the joint fit, with a longer unroll (ours). Started with it, training stalls on the mean forces;
    from a model that already predicts 5 steps it brings the error at the controller's horizon down."""

    epochs: float = 0.0
    unroll: int = 20
    learning_rate: float = 5e-4
    force_weight: float = 2.0
    decode_weight: float = 2.0

    def __post_init__(self) -> None:
        _require(self.unroll >= 1, self, "unroll", "at least 1")
        _require(self.learning_rate > 0, self, "learning_rate", "positive")
        for name in ("epochs", "force_weight", "decode_weight"):
            _require(getattr(self, name) >= 0, self, name, "non-negative")


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """Joint loss, optimiser and distillation (paper, sections 2.2.4 and 2.3)."""

    unroll: int = 5
    force_weight: float = 0.25
    decode_weight: float = 0.0
    """On the forces read from the encoded latents themselves; the paper's loss sees predicted ones only (ours)."""
    variance_weight: float = 0.02
    covariance_weight: float = 0.02
    batch_size: int = 512
    learning_rate: float = 1e-3
    epochs: float = 300.0
    """Passes over the windows of the recording and of its mirror image; fractions are allowed."""
    segment: int = 1
    """Consecutive windows drawn together; 1 draws each on its own, as the paper does. Neighbours share most of
    their work, so 8 makes an iteration several times cheaper for a batch of the same size."""
    schedule: Literal["constant", "one_cycle"] = "constant"
    finish: FinishConfig = field(default_factory=FinishConfig)
    stream_epochs: float = 0.0
    """Passes of the distillation that read the recording as a stream, before those that read windows: they cost a
    small part of them and leave them little to do (ours)."""
    distil_epochs: float = 300.0
    predictor_epochs: float = 10.0
    """Passes over the roll-outs that dynamics and decoder of the slim widths are distilled on (ours)."""
    sensor_noise: float = 0.0
    """Of the slim encoder's inputs while it is distilled, and of the sensors compared by greedy and random selection:
    standard deviation in global deviations of pressure (paper, appendix B). Noise-free, a sensor far upstream that
    barely moves counts as much as one on the base (ours)."""
    sensors: int = 4
    selection: SelectionMethod = "shap"
    """How they are chosen; the others are what the paper's method is measured against (ours)."""
    shap_background: int = 100
    shap_explained: int = 500
    shap_repeats: int = 10
    shap_samples: int = 200
    """Points on the paths from the background to each explained window (shap's default; not in the paper)."""
    seed: int = 0

    def __post_init__(self) -> None:
        for name in (
            "unroll",
            "segment",
            "sensors",
            "shap_background",
            "shap_explained",
            "shap_repeats",
            "shap_samples",
        ):
            _require(getattr(self, name) >= 1, self, name, "at least 1")
        _require(self.batch_size >= 2, self, "batch_size", "at least 2, for the variance over a batch")
        _require(self.segment <= self.batch_size, self, "segment", "at most batch_size")
        for name in ("learning_rate", "epochs", "distil_epochs", "predictor_epochs"):
            _require(getattr(self, name) > 0, self, name, "positive")
        for name in (
            "force_weight",
            "decode_weight",
            "variance_weight",
            "covariance_weight",
            "stream_epochs",
            "sensor_noise",
            "seed",
        ):
            _require(getattr(self, name) >= 0, self, name, "non-negative")


@dataclass(frozen=True, kw_only=True)
class CostWeights:
    """Weights of the MPC cost J (paper, equations 9-11); forces and actions in physical units."""

    drag_mean: float = 1.0
    drag_fluctuation: float = 0.1
    lift: float = 0.01
    lift_mean: float = 0.0
    """On the square of the horizon's mean C_l. Ours: the horizon is one shedding cycle, so this mean is the
    steady deflection of the wake, which the paper's terms let the optimiser trade for drag."""
    smoothness: float = 8.0
    effort: float = 0.0
    rate: float = 0.0
    """On the squared step from the action in force to the first planned one."""

    def __post_init__(self) -> None:
        for item in fields(self):
            _require(getattr(self, item.name) >= 0, self, item.name, "non-negative")

    def as_tuple(self) -> tuple[float, ...]:
        """Weights in declaration order, the order of the controller's `weights` input."""
        return tuple(float(getattr(self, item.name)) for item in fields(self))


@dataclass(frozen=True, kw_only=True)
class MpcConfig:
    """The fixed-iteration optimiser (paper, section 2.4)."""

    horizon: int = 25
    iterations: int = 5
    learning_rate: float = 1e-3
    drag_reference: float = 1.051
    weights: CostWeights = field(default_factory=CostWeights)

    def __post_init__(self) -> None:
        _require(self.horizon >= 2, self, "horizon", "at least 2")
        _require(self.iterations >= 1, self, "iterations", "at least 1")
        _require(self.learning_rate > 0, self, "learning_rate", "positive")
        _require(True, self, "drag_reference", "finite")


@dataclass(frozen=True, kw_only=True)
class E2eConfig:
    """When a receiver of an E2E-protected message trusts the stream (ours)."""

    max_delta: int = 4
    """Largest step of the counter that still counts as the next frame: with 4, three may be lost in a row, as
    many as the ECU's fail-safe rides out."""
    window: int = 5
    """Latest checks that are judged together."""
    min_ok: int = 2
    """Good ones among them that make a stream valid."""
    max_errors: int = 2
    """Most wrong CRCs among them."""

    def __post_init__(self) -> None:
        _require(1 <= self.max_delta <= 127, self, "max_delta", "in 1..127, half the counter's period")
        _require(self.window >= 1, self, "window", "at least 1")
        _require(1 <= self.min_ok <= self.window, self, "min_ok", "in 1..window")
        _require(0 <= self.max_errors < self.window, self, "max_errors", "in 0..window-1")


@dataclass(frozen=True, kw_only=True)
class BusConfig:
    """The CAN FD bus (ours). Bit rates in bit/s."""

    interface: Literal["virtual", "udp_multicast", "slcan", "socketcan"] = "virtual"
    channel: str = "stillwake"
    """A name (virtual), multicast address (udp_multicast, e.g. 239.74.163.2), serial port (slcan) or network
    device (socketcan, e.g. can0)."""
    nominal_bitrate: int = 500_000
    data_bitrate: int = 2_000_000
    e2e: E2eConfig = field(default_factory=E2eConfig)

    def __post_init__(self) -> None:
        for name in ("nominal_bitrate", "data_bitrate"):
            _require(getattr(self, name) > 0, self, name, "positive")
        if not self.channel:
            raise ConfigError("BusConfig.channel = '': must name a channel")


@dataclass(frozen=True, kw_only=True)
class EcuConfig:
    """Timing and fail-safe behaviour of the ECU (ours)."""

    compute_time_ms: float = 8.0
    """Time between frame and command that the virtual ECU charges for its control step. It is a stated
    budget share, not a measurement; measured latency is reported beside it."""
    hold_periods: int = 1
    """Missed periods during which the last command is held."""
    decay_periods: int = 2
    """Missed periods after that during which the command is halved each period, before zero and latch."""
    rearm_frames: int = 5
    """Consecutive good frames, together with an enable edge, that end a latched fault."""
    deadline_misses: int = 3
    """Steps in a row that each came a whole period or more late, after which the ECU switches itself off."""
    delay_steps: int = 0
    """Actuator delay in control periods that the controller compensates (paper, appendix B)."""
    command_step: float = 0.075
    """Largest change of the jet command in one period that the command gate lets pass, in U_inf W: half the full
    range, three times what the training waveform does at full amplitude."""

    def __post_init__(self) -> None:
        _require(self.compute_time_ms >= 0, self, "compute_time_ms", "non-negative")
        _require(self.command_step > 0, self, "command_step", "positive")
        for name in ("hold_periods", "decay_periods", "delay_steps"):
            _require(getattr(self, name) >= 0, self, name, "non-negative")
        for name in ("rearm_frames", "deadline_misses"):
            _require(getattr(self, name) >= 1, self, name, "at least 1")


@dataclass(frozen=True, kw_only=True)
class VehicleConfig:
    """The simulated vehicle (ours)."""

    actuator_delay: int = 0
    """Control periods by which the jets follow a command late. `ecu.delay_steps` is what the controller believes."""

    def __post_init__(self) -> None:
        _require(self.actuator_delay >= 0, self, "actuator_delay", "non-negative")


@dataclass(frozen=True, kw_only=True)
class OpenFoamConfig:
    """The second plant's mesh and start (ours). Its time step in a coupled run is `flow`'s."""

    refinement: float = 1.0
    """Divides every spacing of the body-fitted mesh; the time step must shrink with it."""
    develop_time: float = 50.0
    """Time without jets before a first run, t_c, from the own solver's developed wake."""
    develop_substeps: int = 20
    """Time steps a control period meanwhile."""

    def __post_init__(self) -> None:
        _require(self.refinement > 0, self, "refinement", "positive")
        _require(self.develop_time > 0, self, "develop_time", "positive")
        _require(self.develop_substeps >= 1, self, "develop_substeps", "at least 1")


@dataclass(frozen=True, kw_only=True)
class Config:
    """All settings. Sub-trees are named as in TOML."""

    operating_point: OperatingPoint = field(default_factory=OperatingPoint)
    flow: FlowConfig = field(default_factory=FlowConfig)
    forcing: ForcingConfig = field(default_factory=ForcingConfig)
    model: ModelConfig = field(default_factory=ModelConfig)
    train: TrainConfig = field(default_factory=TrainConfig)
    mpc: MpcConfig = field(default_factory=MpcConfig)
    bus: BusConfig = field(default_factory=BusConfig)
    ecu: EcuConfig = field(default_factory=EcuConfig)
    vehicle: VehicleConfig = field(default_factory=VehicleConfig)
    openfoam: OpenFoamConfig = field(default_factory=OpenFoamConfig)

    @property
    def period_ns(self) -> int:
        """Control period in ns at the operating point; also the latency budget."""
        return self.operating_point.period_ns(self.flow.control_period)
