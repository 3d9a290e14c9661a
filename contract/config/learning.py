"""Settings of the networks and of their training."""

from dataclasses import dataclass, field, replace
from typing import Annotated, Final, Literal

from contract.config.rules import (
    PASSES,
    STEPS,
    WINDOWS,
    AtLeastOne,
    AtLeastOneOrNone,
    Fraction,
    NonNegative,
    Positive,
    Settings,
    at_least,
    ours,
    paper,
    require,
    within,
)

SelectionMethod = Literal["shap", "qr", "greedy", "random", "hand"]
"""How the slim encoder's sensors are chosen (`train.selection`)."""

_ENCODER_ALONE: Final = ours("the paper distils the encoder alone", page="explanation/studies.md#smaller-networks")
_SLIMMED: Final = paper("section 2.3.2", "only the encoder is slimmed")


@dataclass(frozen=True, kw_only=True)
class ModelConfig(Settings, source=paper("table 1")):
    """Shapes of the three networks (paper, table 1)."""

    window: Annotated[AtLeastOne[int], STEPS, paper("section 2.2.1")] = 32
    """L: how many samples back the encoder reads."""
    latent: AtLeastOne[int] = 8
    """Numbers in a latent state."""
    lstm_width: AtLeastOne[int] = 64
    dynamics_width: AtLeastOne[int] = 256
    decoder_width: AtLeastOne[int] = 128
    decoder_blocks: AtLeastOne[int] = 2
    """Residual blocks of the decoder."""
    dropout: Fraction[float] = 0.25
    """Probability, between the decoder's layers, in the joint fit."""
    slim_dynamics_width: Annotated[AtLeastOneOrNone, _SLIMMED] = None
    """Width of the dynamics that the controller rolls out, distilled from the trained ones; None deploys those."""
    slim_decoder_width: Annotated[AtLeastOneOrNone, _SLIMMED] = None
    """The same of the decoder."""

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
class FinishConfig(Settings, section="train.finish", source=ours("the paper has no finish", page="how-to/train.md")):
    """Last passes of the joint fit, with a longer unroll. Started with it, training stalls on the mean forces; from
    a model that already predicts 5 steps it brings the error at the controller's horizon down.

    A field replaces that of the same name in `train`.
    """

    epochs: Annotated[NonNegative[float], PASSES, paper("section 2.2.4", "without a finish")] = 0.0
    """0 leaves the finish out."""
    unroll: Annotated[AtLeastOne[int], STEPS] = 20
    learning_rate: Positive[float] = 5e-4
    force_weight: NonNegative[float] = 2.0
    decode_weight: NonNegative[float] = 2.0


@dataclass(frozen=True, kw_only=True)
class TrainConfig(Settings, source=paper("section 2.2.4")):
    """Joint loss, optimiser and distillation (paper, sections 2.2.4 and 2.3)."""

    unroll: Annotated[AtLeastOne[int], STEPS] = 5
    """k: steps that the dynamics predict from each encoded state, in the loss."""
    force_weight: NonNegative[float] = 0.25
    """Weighs the error of the forces read from predicted latents."""
    decode_weight: Annotated[NonNegative[float], paper("equation 5", "without this term")] = 0.0
    """Weighs the forces read from the encoded latents themselves; the paper's loss sees predicted ones only."""
    variance_weight: NonNegative[float] = 0.02
    """Weighs how far a latent's standard deviation over the batch is below 1."""
    covariance_weight: NonNegative[float] = 0.02
    """Weighs the squared covariances between latents over the batch."""
    batch_size: Annotated[int, at_least(2, "for the variance over a batch"), WINDOWS] = 512
    learning_rate: Positive[float] = 1e-3
    """Learning rate of Adam, in every phase but the finish."""
    epochs: Annotated[Positive[float], PASSES] = 300.0
    """Passes over the windows of the recording and of its mirror image; fractions are allowed."""
    segment: Annotated[
        AtLeastOne[int],
        WINDOWS,
        ours("the plain way; the paper does not give how windows are drawn", page="how-to/train.md"),
    ] = 1
    """Consecutive windows drawn together; 1 draws each on its own. Neighbours share most of their work, so 8 makes an
    iteration several times cheaper for a batch of the same size."""
    streamed: Annotated[bool, paper("section 2.2.1", "the encoder reads windows")] = False
    """Whether the joint fit reads each drawn stretch once, with the LSTM's state carried on, instead of window by
    window; the passes of `finish` read windows in any case."""
    schedule: Annotated[Literal["constant", "one_cycle"], paper("section 2.2.4", "one learning rate")] = "constant"
    """Course of the learning rate over a phase's steps; `one_cycle` raises it to `train.learning_rate`, then
    lowers it to zero."""
    finish: FinishConfig = field(default_factory=FinishConfig)
    stream_epochs: Annotated[NonNegative[float], PASSES, paper("section 2.3.2", "the encoder reads windows")] = 0.0
    """Passes of the distillation that read the recording as a stream, before those that read windows: they cost a
    small part of them and leave them little to do."""
    distil_epochs: Annotated[Positive[float], PASSES, ours("as in the joint fit; the paper gives none")] = 300.0
    """Passes of the distillation of the slim encoder that read windows."""
    predictor_epochs: Annotated[Positive[float], PASSES, _ENCODER_ALONE] = 10.0
    """Passes over the roll-outs that dynamics and decoder of the slim widths are distilled on."""
    predictor_lessons: Annotated[AtLeastOne[int], _ENCODER_ALONE] = 65536
    """Roll-outs of the trained networks that these learn from (`train.distillation.lessons`), at least."""
    slope_weight: Annotated[NonNegative[float], _ENCODER_ALONE] = 0.0
    """Weighs the cost's slope along the plan, beside latents and forces, where dynamics and decoder are distilled."""
    sensor_noise: Annotated[NonNegative[float], paper("appendix B", "noise in tests only")] = 0.0
    """Noise on the slim encoder's inputs while it is distilled, and on sensors compared by greedy and random selection:
    standard deviation in global deviations of pressure (paper, appendix B). Noise-free, a sensor far upstream that
    barely moves counts as much as one on the base."""
    sensors: Annotated[AtLeastOne[int], paper("section 3.2")] = 4
    """How many sensors the slim encoder reads."""
    selection: Annotated[SelectionMethod, paper("section 2.3.1")] = "shap"
    """How they are chosen; the others are what the paper's method is measured against."""
    shap_background: Annotated[AtLeastOne[int], WINDOWS, paper("section 2.3.1")] = 100
    """Drawn as the reference for a typical input."""
    shap_explained: Annotated[AtLeastOne[int], WINDOWS, paper("section 2.3.1")] = 500
    """Drawn to score the sensors on."""
    shap_repeats: Annotated[AtLeastOne[int], paper("section 2.3.1")] = 10
    """Rankings with draws of their own."""
    shap_samples: Annotated[AtLeastOne[int], ours("the default of the package shap; the paper gives none")] = 200
    """Points on the paths from the background to each explained window."""
    seed: Annotated[NonNegative[int], ours("any would do; the paper gives none")] = 0
    """Seed of initial weights, batches, draws and noise."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.segment <= self.batch_size, self, "segment", "at most batch_size")


@dataclass(frozen=True, kw_only=True)
class RefineConfig(Settings, source=ours("the paper has no prior", page="explanation/through-the-flow.md")):
    """Training of the plan's prior through the flow, in closed loop."""

    memory: Annotated[int, at_least(2), STEPS] = 64
    """Rows of sensor differences and actions that the prior reads."""
    units: AtLeastOne[int] = 24
    """The width of the prior's hidden layer."""
    updates: AtLeastOne[int] = 450
    """Updates of its weights, one a stretch of closed loop."""
    shortest: Annotated[int, at_least(2), STEPS] = 75
    """Length of a stretch in the first updates; it grows to `longest` over the first half of them. The flow takes 65
    control periods from the jets to the far end of the bubble."""
    longest: Annotated[int, at_least(2), STEPS] = 125
    """Length of a stretch in the second half."""
    streams: AtLeastOne[int] = 4
    """Flows under the prior that stretches are cut from in turn."""
    stretches: AtLeastOne[int] = 10
    """Stretches after which a stream begins again in the developed wake; 2 more for each further stream."""
    learning_rate: Positive[float] = 5e-3
    """The learning rate of Adam at the start."""
    last_rate: Positive[float] = 0.1
    """What is left of it at the end."""
    lift_price: NonNegative[float] = 0.04
    """The price of the lift coefficient's magnitude, in units of the drag coefficient."""
    effort_price: NonNegative[float] = 0.0
    """The price of the squared action in force."""
    goals: bool = False
    """Whether prices of lift and effort, and a limit of the jets, are drawn for each stream, half of each at those
    above."""
    motion_price: NonNegative[float] = 0.2
    """The price of the squared transverse velocity at the wake probe, which foretells drag beyond a stretch."""
    sensor_noise: NonNegative[float] = 0.3
    """Largest standard deviation of noise on the sensors, in global deviations of pressure; mostly it is far less."""
    offset: NonNegative[float] = 0.0
    """Standard deviation of an offset in Cp that both sensors of a pair have for a stretch."""
    speed_error: Annotated[float, within(0.0, 0.5, "a speed")] = 0.0
    """Largest share by which the speed that the prior is told is wrong for a stretch; half of them are told rightly."""
    loss: Fraction[float] = 0.0
    """Largest share of periods without pressures; half of the stretches have none."""
    refinement: Positive[float] = 0.75
    """The refinement of the training's grid, as `flow.refinement`: a quarter of the default one's cost, and the
    coarsest on which a controller does what it does on the default one."""
    substeps: AtLeastOne[int] = 15
    """Time steps a control period on that grid, at the design speed; more at higher ones."""
    single_precision: bool = True
    """Whether the flow of the training has 32 bits, in two thirds of the time; the gradient is that of 64 to 1e-5."""
    batch: AtLeastOne[int] = 1
    """Stretches that an update rests on, each of another stream."""
    slowest: Annotated[float, within(0.1, 1.0, "the design speed belongs to the range")] = 1.0
    """The smallest ratio of a speed in training to the design speed."""
    fastest: Annotated[float, within(1.0, 10.0, "the design speed belongs to the range")] = 1.0
    """The largest ratio of a speed in training to the design speed; speeds are drawn in between, and change within
    stretches."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.batch <= self.streams, self, "batch", "at most streams")
        require(self.shortest > self.memory, self, "shortest", "more than memory")
        require(self.longest >= self.shortest, self, "longest", "at least shortest")
