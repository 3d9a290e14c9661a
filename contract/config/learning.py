"""The settings of the networks and of their training."""

from dataclasses import dataclass, field, replace
from typing import Annotated, Final, Literal

from contract.config.notes import PASSES, STEPS, WINDOWS, ours, paper
from contract.config.rules import AtLeastOne, Fraction, NonNegative, Positive, Rule, Settings, at_least, require, within

SelectionMethod = Literal["shap", "qr", "greedy", "random", "hand"]
"""The methods that choose the sensors of the slim encoder, which reads only a few sensors (`train.selection`)."""
_WidthOrNone = Annotated[int | None, Rule(wording="at least 1", holds=lambda value: value is None or value >= 1)]
_ENCODER_ALONE: Final = ours("the paper distils the encoder alone", page="explanation/studies.md#smaller-networks")
_SLIMMED: Final = paper("section 2.3.2", "the paper reduces only the encoder")
_SIMPLEST: Final = ours("the simplest draw; the paper does not state how windows are drawn", page="how-to/train.md")


@dataclass(frozen=True, kw_only=True)
class ModelConfig(Settings, source=paper("table 1")):
    """The shapes of the three networks (paper, table 1)."""

    window: Annotated[AtLeastOne[int], STEPS, paper("section 2.2.1")] = 32
    """L: number of past samples that the encoder reads."""
    latent: AtLeastOne[int] = 8
    """Dimension of the latent state."""
    lstm_width: AtLeastOne[int] = 64
    dynamics_width: AtLeastOne[int] = 256
    decoder_width: AtLeastOne[int] = 128
    decoder_blocks: AtLeastOne[int] = 2
    """Number of residual blocks in the decoder."""
    dropout: Fraction[float] = 0.25
    """Dropout probability between the decoder's layers during the joint fit."""
    slim_dynamics_width: Annotated[_WidthOrNone, _SLIMMED] = None
    """Width of the deployed dynamics network, distilled from the trained network. None deploys the trained network."""
    slim_decoder_width: Annotated[_WidthOrNone, _SLIMMED] = None
    """Width of the deployed decoder, distilled from the trained decoder. None deploys the trained decoder."""

    @property
    def slim(self) -> "ModelConfig":
        """The shapes of the deployed networks. Their dropout is 0, because they are fitted to outputs without noise."""
        return replace(
            self,
            dynamics_width=self.slim_dynamics_width or self.dynamics_width,
            decoder_width=self.slim_decoder_width or self.decoder_width,
            dropout=0.0,
        )

    @property
    def is_slimmed(self) -> bool:
        """Whether the dynamics network or the decoder is distilled in addition to the encoder."""
        return self.slim_dynamics_width is not None or self.slim_decoder_width is not None


@dataclass(frozen=True, kw_only=True)
class FinishConfig(Settings, section="train.finish", source=ours("the paper has no finish", page="how-to/train.md")):
    """The finish consists of the last passes of the joint fit. The earlier passes predict 5 steps. The finish predicts
    more steps, to reduce the error at the controller's horizon. Training that begins with so many steps fails: the
    model then predicts only the mean forces.

    In the finish, each of these fields replaces the field of `train` with the same name.
    """

    epochs: Annotated[NonNegative[float], PASSES, paper("section 2.2.4", "without a finish")] = 0.0
    """Number of passes of the finish; 0 skips it."""
    unroll: Annotated[AtLeastOne[int], STEPS] = 20
    learning_rate: Positive[float] = 5e-4
    force_weight: NonNegative[float] = 2.0
    decode_weight: NonNegative[float] = 2.0


@dataclass(frozen=True, kw_only=True)
class TrainConfig(Settings, source=paper("section 2.2.4")):
    """The joint loss, the optimiser and the distillation (paper, sections 2.2.4 and 2.3)."""

    unroll: Annotated[AtLeastOne[int], STEPS] = 5
    """k: number of steps that the dynamics network predicts from each encoded state to compute the loss."""
    force_weight: NonNegative[float] = 0.25
    """Weight of a loss term: the error of the forces decoded from predicted latents."""
    decode_weight: Annotated[NonNegative[float], paper("equation 5", "without this term")] = 0.0
    """Weight of a loss term: the error of the forces decoded from encoded latents. The paper has no such term."""
    variance_weight: NonNegative[float] = 0.02
    """Weight of a loss term: the amount by which a latent's standard deviation over the batch is below 1."""
    covariance_weight: NonNegative[float] = 0.02
    """Weight of a loss term: the squared covariances between latents over the batch."""
    batch_size: Annotated[int, at_least(2, "for the variance over a batch"), WINDOWS] = 512
    learning_rate: Positive[float] = 1e-3
    """Learning rate of Adam in every phase except the finish."""
    epochs: Annotated[Positive[float], PASSES] = 300.0
    """Passes over the windows of the recording and of its mirror image; fractions are allowed."""
    segment: Annotated[AtLeastOne[int], WINDOWS, _SIMPLEST] = 1
    """Number of consecutive windows drawn together; 1 draws each window separately. Consecutive windows share most of
    their computation, so segments of 8 windows make an iteration several times cheaper at an equal batch size."""
    streamed: Annotated[bool, paper("section 2.2.1", "the encoder reads windows")] = False
    """Whether the joint fit reads each segment once and carries the LSTM's state from row to row, instead of reading
    each window from its start. The passes of `finish` always read windows."""
    schedule: Annotated[Literal["constant", "one_cycle"], paper("section 2.2.4", "one learning rate")] = "constant"
    """Course of the learning rate over a phase: `constant` or `one_cycle`. With `one_cycle` the rate rises to
    `train.learning_rate` and then falls to 0."""
    finish: FinishConfig = field(default_factory=FinishConfig)
    stream_epochs: Annotated[NonNegative[float], PASSES, paper("section 2.3.2", "the encoder reads windows")] = 0.0
    """Number of distillation passes that read the recording as a stream. These passes come before the passes that read
    windows, and take far less time. The passes that read windows reduce the error only a little further."""
    distil_epochs: Annotated[Positive[float], PASSES, ours("as in the joint fit; the paper gives no number")] = 300.0
    """Number of distillation passes that read windows, for the slim encoder."""
    predictor_epochs: Annotated[Positive[float], PASSES, _ENCODER_ALONE] = 10.0
    """Number of passes over the roll-outs from which the slim dynamics and decoder are distilled."""
    predictor_lessons: Annotated[AtLeastOne[int], _ENCODER_ALONE] = 65536
    """Smallest number of roll-outs to distil the slim dynamics and decoder from (`train.distillation.lessons`)."""
    slope_weight: Annotated[NonNegative[float], _ENCODER_ALONE] = 0.0
    """Weight of a term in the distillation of dynamics and decoder: the error of the cost's gradient with respect to
    the plan. The errors of latents and forces have weight 1."""
    sensor_noise: Annotated[NonNegative[float], paper("appendix B", "noise in tests only")] = 0.0
    """Standard deviation of sensor noise, in global standard deviations of pressure (paper, appendix B). The
    distillation adds the noise to the slim encoder's inputs. Greedy and random selection assume this noise on all
    sensors. Without noise, a sensor far upstream with small fluctuations counts as much as a sensor on the base."""
    sensors: Annotated[AtLeastOne[int], paper("section 3.2")] = 4
    """Number of sensors that the slim encoder reads."""
    selection: Annotated[SelectionMethod, paper("section 2.3.1")] = "shap"
    """Method that chooses the slim encoder's sensors. `shap` is the paper's method; the others are for comparison."""
    shap_background: Annotated[AtLeastOne[int], WINDOWS, paper("section 2.3.1")] = 100
    """Number of random windows that represent the typical input (the background of SHAP)."""
    shap_explained: Annotated[AtLeastOne[int], WINDOWS, paper("section 2.3.1")] = 500
    """Number of windows that SHAP explains to compute the sensors' scores."""
    shap_repeats: Annotated[AtLeastOne[int], paper("section 2.3.1")] = 10
    """Number of SHAP rankings of the sensors, each with new random draws."""
    shap_samples: Annotated[AtLeastOne[int], ours("the default of the package shap; the paper gives none")] = 200
    """Number of points on the paths from the background to each explained window."""
    seed: Annotated[NonNegative[int], ours("an arbitrary number; the paper gives none")] = 0
    """Random seed of initial weights, batches and noise."""

    def _check_together(self) -> None:
        require(self.segment <= self.batch_size, self, "segment", "at most batch_size")


@dataclass(frozen=True, kw_only=True)
class RefineConfig(Settings, source=ours("the paper has no prior", page="explanation/through-the-flow.md")):
    """The training of the prior, the network that computes the optimiser's initial plan. In training the prior controls
    simulated flows. A stretch is an interval of such a flow. The cost over a stretch is differentiated through the flow
    solver with respect to the prior's weights."""

    memory: Annotated[int, at_least(2), STEPS] = 64
    """Number of past rows that the prior reads. A row has an action and pressure differences of mirrored sensors."""
    units: AtLeastOne[int] = 24
    """Width of the prior's hidden layer."""
    updates: AtLeastOne[int] = 450
    """Number of updates of the prior's weights, each computed from `refine.batch` stretches."""
    shortest: Annotated[int, at_least(2), STEPS] = 75
    """Length of a stretch at the design speed in the first update; at other speeds a stretch has the same length in
    convective times. The length grows to `longest` over the first half of the updates. The effect of the jets takes 65
    control periods to reach the far end of the recirculation bubble."""
    longest: Annotated[int, at_least(2), STEPS] = 125
    """Length of a stretch in the second half of the updates."""
    streams: AtLeastOne[int] = 4
    """Number of simulated flows that the prior controls in turn, one stretch each."""
    stretches: AtLeastOne[int] = 10
    """Number of stretches after which the first flow restarts from the developed wake. Each further flow restarts after
    2 stretches more than the flow before it."""
    learning_rate: Positive[float] = 5e-3
    """Initial learning rate of Adam."""
    last_rate: Positive[float] = 0.1
    """Ratio of the final to the initial learning rate."""
    lift_price: NonNegative[float] = 0.04
    """Weight of the lift coefficient's magnitude in the cost, at most 1; the drag's weight is 1."""
    effort_price: NonNegative[float] = 0.0
    """Weight of the squared action in the cost, at most 9; the drag's weight is 1."""
    goals: bool = False
    """Whether each flow has random weights of lift and effort and a random limit of the jets. Each of these three
    values equals the configured value with probability one half."""
    motion_price: NonNegative[float] = 0.2
    """Weight of the squared transverse velocity at the wake probe, which indicates the drag after the stretch."""
    sensor_noise: NonNegative[float] = 0.3
    """Largest standard deviation of a sensor's noise, in standard deviations of this sensor's recorded pressure; most
    stretches have far less noise."""
    offset: NonNegative[float] = 0.0
    """Standard deviation of a random offset in Cp, constant in a stretch and equal for both sensors of a pair."""
    speed_error: Annotated[float, within(0.0, 0.5, "a larger error is unrealistic")] = 0.0
    """Largest relative error of the speed that the prior reads; constant in a stretch, 0 in half of the stretches."""
    loss: Fraction[float] = 0.0
    """Largest share of a stretch's periods whose pressures are lost; in half of the stretches no pressures are lost."""
    refinement: Positive[float] = 0.75
    """Refinement of the training's grid, like `flow.refinement`. The default takes a quarter of the time of refinement
    1. Controllers trained on a coarser grid than the default behave differently from controllers trained with 1."""
    substeps: AtLeastOne[int] = 15
    """Number of time steps per control period on the training's grid at the design speed; higher speeds use more."""
    single_precision: bool = True
    """Whether the training computes the flow in single precision. This takes two thirds of the time of double
    precision; the gradients agree to 1e-5."""
    batch: AtLeastOne[int] = 1
    """Number of stretches over which an update averages the gradient. Each stretch belongs to a different flow."""
    slowest: Annotated[float, within(0.1, 1.0, "the design speed belongs to the range")] = 1.0
    """Smallest ratio of a training speed to the design speed."""
    fastest: Annotated[float, within(1.0, 10.0, "the design speed belongs to the range")] = 1.0
    """Largest ratio of a training speed to the design speed. Speeds vary randomly from `slowest` to `fastest`."""

    def _check_together(self) -> None:
        require(self.batch <= self.streams, self, "batch", "at most streams")
        require(self.shortest > self.memory, self, "shortest", "more than refine.memory")
        require(self.longest >= self.shortest, self, "longest", "at least shortest")
