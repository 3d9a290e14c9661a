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
"""The methods that choose the slim encoder's sensors (`train.selection`)."""

_ENCODER_ALONE: Final = ours("the paper distils the encoder alone", page="explanation/studies.md#smaller-networks")
_SLIMMED: Final = paper("section 2.3.2", "the paper reduces only the encoder")


@dataclass(frozen=True, kw_only=True)
class ModelConfig(Settings, source=paper("table 1")):
    """Shapes of the three networks (paper, table 1)."""

    window: Annotated[AtLeastOne[int], STEPS, paper("section 2.2.1")] = 32
    """L: number of past samples that the encoder reads."""
    latent: AtLeastOne[int] = 8
    """Dimension of the latent state."""
    lstm_width: AtLeastOne[int] = 64
    dynamics_width: AtLeastOne[int] = 256
    decoder_width: AtLeastOne[int] = 128
    decoder_blocks: AtLeastOne[int] = 2
    """Residual blocks in the decoder."""
    dropout: Fraction[float] = 0.25
    """Dropout probability between the decoder's layers during the joint fit."""
    slim_dynamics_width: Annotated[AtLeastOneOrNone, _SLIMMED] = None
    """Width of the deployed dynamics, distilled from the trained dynamics. None deploys the trained dynamics."""
    slim_decoder_width: Annotated[AtLeastOneOrNone, _SLIMMED] = None
    """Width of the deployed decoder, distilled from the trained decoder. None deploys the trained decoder."""

    @property
    def slim(self) -> "ModelConfig":
        """Return the shapes of the deployed networks. Dropout is 0, because the teacher's outputs have no noise."""
        return replace(
            self,
            dynamics_width=self.slim_dynamics_width or self.dynamics_width,
            decoder_width=self.slim_decoder_width or self.decoder_width,
            dropout=0.0,
        )

    @property
    def is_slimmed(self) -> bool:
        """Whether the dynamics or the decoder is distilled in addition to the encoder."""
        return self.slim_dynamics_width is not None or self.slim_decoder_width is not None


@dataclass(frozen=True, kw_only=True)
class FinishConfig(Settings, section="train.finish", source=ours("the paper has no finish", page="how-to/train.md")):
    """Last passes of the joint fit, with a longer unroll. A training that starts with it stalls at the mean forces; on
    a model that predicts 5 steps, it reduces the error at the controller's horizon.

    Its fields replace those of the same name in `train`.
    """

    epochs: Annotated[NonNegative[float], PASSES, paper("section 2.2.4", "without a finish")] = 0.0
    """Passes of the finish; 0 skips it."""
    unroll: Annotated[AtLeastOne[int], STEPS] = 20
    learning_rate: Positive[float] = 5e-4
    force_weight: NonNegative[float] = 2.0
    decode_weight: NonNegative[float] = 2.0


@dataclass(frozen=True, kw_only=True)
class TrainConfig(Settings, source=paper("section 2.2.4")):
    """Joint loss, optimiser and distillation (paper, sections 2.2.4 and 2.3)."""

    unroll: Annotated[AtLeastOne[int], STEPS] = 5
    """k: number of steps that the dynamics predict from each encoded state in the loss."""
    force_weight: NonNegative[float] = 0.25
    """Weight of the error of the forces decoded from predicted latents."""
    decode_weight: Annotated[NonNegative[float], paper("equation 5", "without this term")] = 0.0
    """Weight of the error of the forces decoded from the encoded latents. The paper's loss uses predicted latents only.
    """
    variance_weight: NonNegative[float] = 0.02
    """Weight of the amount by which a latent's standard deviation over the batch is below 1."""
    covariance_weight: NonNegative[float] = 0.02
    """Weight of the squared covariances between latents over the batch."""
    batch_size: Annotated[int, at_least(2, "for the variance over a batch"), WINDOWS] = 512
    learning_rate: Positive[float] = 1e-3
    """Learning rate of Adam in every phase except the finish."""
    epochs: Annotated[Positive[float], PASSES] = 300.0
    """Passes over the windows of the recording and of its mirror image; fractions are allowed."""
    segment: Annotated[
        AtLeastOne[int],
        WINDOWS,
        ours("the simplest draw; the paper does not state how windows are drawn", page="how-to/train.md"),
    ] = 1
    """Consecutive windows drawn together; 1 draws each window separately. Consecutive windows share most of their
    computation, so 8 makes an iteration several times cheaper at the same batch size."""
    streamed: Annotated[bool, paper("section 2.2.1", "the encoder reads windows")] = False
    """Whether the joint fit reads each drawn segment once and carries the LSTM's state on, instead of reading window by
    window. The passes of `finish` always read windows."""
    schedule: Annotated[Literal["constant", "one_cycle"], paper("section 2.2.4", "one learning rate")] = "constant"
    """Learning rate over a phase's steps; `one_cycle` raises it to `train.learning_rate`, then lowers it to 0."""
    finish: FinishConfig = field(default_factory=FinishConfig)
    stream_epochs: Annotated[NonNegative[float], PASSES, paper("section 2.3.2", "the encoder reads windows")] = 0.0
    """Passes of the distillation that read the recording as a stream. They come before the passes that read windows,
    cost far less, and leave little for those to improve."""
    distil_epochs: Annotated[Positive[float], PASSES, ours("as in the joint fit; the paper gives none")] = 300.0
    """Passes of the slim encoder's distillation that read windows."""
    predictor_epochs: Annotated[Positive[float], PASSES, _ENCODER_ALONE] = 10.0
    """Passes over the roll-outs from which the slim dynamics and decoder are distilled."""
    predictor_lessons: Annotated[AtLeastOne[int], _ENCODER_ALONE] = 65536
    """Smallest number of roll-outs that the slim dynamics and decoder learn from (`train.distillation.lessons`)."""
    slope_weight: Annotated[NonNegative[float], _ENCODER_ALONE] = 0.0
    """Weight of the error of the cost's gradient along the plan, beside those of latents and forces (1), in the
    distillation of dynamics and decoder."""
    sensor_noise: Annotated[NonNegative[float], paper("appendix B", "noise in tests only")] = 0.0
    """Noise on the slim encoder's inputs during distillation, and on the sensors that greedy and random selection
    compare: standard deviation in global standard deviations of pressure (paper, appendix B). Without noise, a sensor
    far upstream with small fluctuations counts as much as a sensor on the base."""
    sensors: Annotated[AtLeastOne[int], paper("section 3.2")] = 4
    """Sensors that the slim encoder reads."""
    selection: Annotated[SelectionMethod, paper("section 2.3.1")] = "shap"
    """Method that chooses the slim encoder's sensors. `shap` is the paper's method; the others serve as comparison."""
    shap_background: Annotated[AtLeastOne[int], WINDOWS, paper("section 2.3.1")] = 100
    """Windows drawn as background, which represents the typical input."""
    shap_explained: Annotated[AtLeastOne[int], WINDOWS, paper("section 2.3.1")] = 500
    """Windows drawn for the scores of the sensors."""
    shap_repeats: Annotated[AtLeastOne[int], paper("section 2.3.1")] = 10
    """Rankings, each with its own random draws."""
    shap_samples: Annotated[AtLeastOne[int], ours("the default of the package shap; the paper gives none")] = 200
    """Points on the paths from the background to each explained window."""
    seed: Annotated[NonNegative[int], ours("an arbitrary number; the paper gives none")] = 0
    """Random seed of initial weights, batches, draws and noise."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.segment <= self.batch_size, self, "segment", "at most batch_size")


@dataclass(frozen=True, kw_only=True)
class RefineConfig(Settings, source=ours("the paper has no prior", page="explanation/through-the-flow.md")):
    """Training of the prior in closed loop, through the flow."""

    memory: Annotated[int, at_least(2), STEPS] = 64
    """Rows of sensor differences and actions that the prior reads."""
    units: AtLeastOne[int] = 24
    """Width of the prior's hidden layer."""
    updates: AtLeastOne[int] = 450
    """Updates of the prior's weights, each from `refine.batch` stretches of closed loop."""
    shortest: Annotated[int, at_least(2), STEPS] = 75
    """Length of a stretch in the first update; it grows to `longest` over the first half of the updates. The effect of
    the jets takes 65 control periods to reach the far end of the recirculation bubble."""
    longest: Annotated[int, at_least(2), STEPS] = 125
    """Length of a stretch in the second half of the updates."""
    streams: AtLeastOne[int] = 4
    """Flows controlled by the prior; the stretches are cut from them in turn."""
    stretches: AtLeastOne[int] = 10
    """Stretches after which the first stream restarts from the developed wake; each further stream runs 2 more."""
    learning_rate: Positive[float] = 5e-3
    """Initial learning rate of Adam."""
    last_rate: Positive[float] = 0.1
    """Ratio of the final to the initial learning rate."""
    lift_price: NonNegative[float] = 0.04
    """Weight of the lift coefficient's magnitude in the cost; the drag's weight is 1."""
    effort_price: NonNegative[float] = 0.0
    """Weight of the squared action in force in the cost."""
    goals: bool = False
    """Whether each stream draws its own weights of lift and effort and limit of the jets; each keeps the configured
    value with probability one half."""
    motion_price: NonNegative[float] = 0.2
    """Weight of the squared transverse velocity at the wake probe, which indicates drag after a stretch's end."""
    sensor_noise: NonNegative[float] = 0.3
    """Largest standard deviation of sensor noise, in global deviations of pressure; most stretches have far less."""
    offset: NonNegative[float] = 0.0
    """Standard deviation of an offset in Cp that both sensors of a mirrored pair have during a stretch."""
    speed_error: Annotated[float, within(0.0, 0.5, "a speed")] = 0.0
    """Largest relative error of the prior's input speed, constant during a stretch; half of the stretches have none."""
    loss: Fraction[float] = 0.0
    """Largest share of periods without pressures in a stretch; half of the stretches lose none."""
    refinement: Positive[float] = 0.75
    """Refinement of the training's grid, like `flow.refinement`. The default takes a quarter of the time of 1, and is
    the coarsest grid on which a controller behaves as it does at 1."""
    substeps: AtLeastOne[int] = 15
    """Time steps per control period on the training's grid at the design speed; higher speeds use more."""
    single_precision: bool = True
    """Whether the training's flow uses 32 bits, which takes two thirds of the time; the gradient agrees to 1e-5."""
    batch: AtLeastOne[int] = 1
    """Stretches that are averaged in one update, each from a different stream."""
    slowest: Annotated[float, within(0.1, 1.0, "the design speed belongs to the range")] = 1.0
    """Smallest ratio of a training speed to the design speed."""
    fastest: Annotated[float, within(1.0, 10.0, "the design speed belongs to the range")] = 1.0
    """Largest ratio of a training speed to the design speed; the speed varies randomly up to it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.batch <= self.streams, self, "batch", "at most streams")
        require(self.shortest > self.memory, self, "shortest", "more than refine.memory")
        require(self.longest >= self.shortest, self, "longest", "at least shortest")
