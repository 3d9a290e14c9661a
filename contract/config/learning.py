"""Settings of the networks and of their training.

Not in the paper: the slim widths, `FinishConfig`, `decode_weight`, `stream_epochs`, `predictor_epochs`,
`predictor_lessons`, `slope_weight`, `sensor_noise` in training, `shap_samples`, and every `selection` but "shap".
"""

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

from contract.config.rules import (
    AtLeastOne,
    AtLeastOneOrNone,
    Fraction,
    NonNegative,
    Positive,
    Settings,
    at_least,
    require,
)
from contract.config.units import PASSES, STEPS, WINDOWS

SelectionMethod = Literal["shap", "qr", "greedy", "random", "hand"]
"""How the slim encoder's sensors are chosen (`train.selection`)."""


@dataclass(frozen=True, kw_only=True)
class ModelConfig(Settings):
    """Shapes of the three networks (paper, table 1)."""

    window: Annotated[AtLeastOne[int], STEPS] = 32
    latent: AtLeastOne[int] = 8
    lstm_width: AtLeastOne[int] = 64
    dynamics_width: AtLeastOne[int] = 256
    decoder_width: AtLeastOne[int] = 128
    decoder_blocks: AtLeastOne[int] = 2
    dropout: Fraction[float] = 0.25
    slim_dynamics_width: AtLeastOneOrNone = None
    """Of the dynamics that the controller rolls out, distilled from the trained ones; None deploys those."""
    slim_decoder_width: AtLeastOneOrNone = None

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
class FinishConfig(Settings, section="train.finish"):
    """Last passes of the joint fit, with a longer unroll. Started with it, training stalls on the mean forces; from
    a model that already predicts 5 steps it brings the error at the controller's horizon down.

    A field replaces that of the same name in `train`.
    """

    epochs: Annotated[NonNegative[float], PASSES] = 0.0
    unroll: Annotated[AtLeastOne[int], STEPS] = 20
    learning_rate: Positive[float] = 5e-4
    force_weight: NonNegative[float] = 2.0
    decode_weight: NonNegative[float] = 2.0


@dataclass(frozen=True, kw_only=True)
class TrainConfig(Settings):
    """Joint loss, optimiser and distillation (paper, sections 2.2.4 and 2.3)."""

    unroll: Annotated[AtLeastOne[int], STEPS] = 5
    force_weight: NonNegative[float] = 0.25
    decode_weight: NonNegative[float] = 0.0
    """On the forces read from the encoded latents themselves; the paper's loss sees predicted ones only."""
    variance_weight: NonNegative[float] = 0.02
    covariance_weight: NonNegative[float] = 0.02
    batch_size: Annotated[int, at_least(2, "for the variance over a batch"), WINDOWS] = 512
    learning_rate: Positive[float] = 1e-3
    epochs: Annotated[Positive[float], PASSES] = 300.0
    """Passes over the windows of the recording and of its mirror image; fractions are allowed."""
    segment: Annotated[AtLeastOne[int], WINDOWS] = 1
    """Consecutive windows drawn together; 1 draws each on its own, as the paper does. Neighbours share most of
    their work, so 8 makes an iteration several times cheaper for a batch of the same size."""
    streamed: bool = False
    """Whether the joint fit reads each drawn stretch once, with the LSTM's state carried on, instead of window by
    window; the passes of `finish` read windows in any case."""
    schedule: Literal["constant", "one_cycle"] = "constant"
    finish: FinishConfig = field(default_factory=FinishConfig)
    stream_epochs: Annotated[NonNegative[float], PASSES] = 0.0
    """Passes of the distillation that read the recording as a stream, before those that read windows: they cost a
    small part of them and leave them little to do."""
    distil_epochs: Annotated[Positive[float], PASSES] = 300.0
    predictor_epochs: Annotated[Positive[float], PASSES] = 10.0
    """Passes over the roll-outs that dynamics and decoder of the slim widths are distilled on."""
    predictor_lessons: AtLeastOne[int] = 65536
    """Roll-outs of the trained networks that these learn from (`train.lessons`), at least."""
    slope_weight: NonNegative[float] = 0.0
    """Of the slope of the cost along the plan when these are distilled, beside their latents and forces."""
    sensor_noise: NonNegative[float] = 0.0
    """Of the slim encoder's inputs while it is distilled, and of the sensors compared by greedy and random selection:
    standard deviation in global deviations of pressure (paper, appendix B). Noise-free, a sensor far upstream that
    barely moves counts as much as one on the base."""
    sensors: AtLeastOne[int] = 4
    selection: SelectionMethod = "shap"
    """How they are chosen; the others are what the paper's method is measured against."""
    shap_background: Annotated[AtLeastOne[int], WINDOWS] = 100
    shap_explained: Annotated[AtLeastOne[int], WINDOWS] = 500
    shap_repeats: AtLeastOne[int] = 10
    shap_samples: AtLeastOne[int] = 200
    """Points on the paths from the background to each explained window; shap's default."""
    seed: NonNegative[int] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.segment <= self.batch_size, self, "segment", "at most batch_size")
