"""The open-loop forcing signals (paper, section 2.1), the exploration noise, and the plans of a recording's episodes.

A round is a set of episodes that is added to a data set. Its episodes run under a controller, or start from the steady
wake. A round under a controller adds the flow states that the controller of the last round reaches (DAgger: Ross,
Gordon and Bagnell 2011). Calm episodes begin at the steady wake. Small random actions disturb this wake, and the
disturbances grow until vortices are shed. The amplitude of the actions differs between episodes. A model that is
trained without calm episodes predicts this growth wrongly, because no other episode comes near the steady wake.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any, ClassVar, Final, Literal, get_args

import numpy as np
import numpy.typing as npt
from scipy.signal import butter, lfilter, sosfilt

from contract.arrays import Array
from contract.config.plant import FlowConfig, ForcingConfig
from contract.config.tree import Config
from contract.errors import ConfigError
from contract.recording.dataset import Role

ForcingName = Literal["training", "chirp", "extended_chirp", "none"]


def training(steps: int, forcing: ForcingConfig, flow: FlowConfig, rng: np.random.Generator) -> Array:
    """Compute the training waveform, (steps,), in U_inf W. The carrier's frequency is near the shedding frequency and
    varies with noise. The noise is low-pass filtered and divided by its largest magnitude. The amplitude varies slowly
    and sinusoidally, up to 1 + depth. So the strongest parts are clipped, and the full amplitude is explored."""
    dt = flow.control_period
    # The filter starts from zero, so its output is discarded until the time 4 / (cut-off frequency).
    settle = int(4.0 / (forcing.modulation_cutoff * dt))
    if (cutoff := forcing.modulation_cutoff) >= 0.5 / dt:
        raise ConfigError(f"forcing.modulation_cutoff = {cutoff:g}: must be below {0.5 / dt:g}, half the control rate")
    lowpass = butter(2, forcing.modulation_cutoff, fs=1.0 / dt, output="sos")
    eta = sosfilt(lowpass, rng.standard_normal(settle + steps))[settle:]
    eta /= np.abs(eta).max()
    frequency = forcing.base_frequency + forcing.modulation_index * eta
    phase = 2.0 * np.pi * (rng.random() + np.cumsum(frequency) * dt)
    t = np.arange(steps) * dt
    envelope = 1.0 + forcing.envelope_depth * np.sin(2.0 * np.pi * (forcing.envelope_frequency * t + rng.random()))
    signal: Array = flow.action_limit * np.clip(envelope * np.sin(phase), -1.0, 1.0)
    return signal


def sine(steps: int, flow: FlowConfig, *, amplitude: float, frequency: float) -> Array:
    """Compute a sine that rises from zero, (steps,), in U_inf W; the frequency is in 1/t_c. Raises ConfigError if the
    amplitude exceeds the bound, or if the frequency is not between 0 and half the control rate."""
    if not 0.0 <= amplitude <= flow.action_limit:
        raise ConfigError(f"amplitude = {amplitude}: must be between 0 and {flow.action_limit}")
    highest = 0.5 / flow.control_period
    if not 0.0 < frequency < highest:
        raise ConfigError(f"frequency = {frequency}: must be positive and below {highest}, half the control rate")
    signal: Array = amplitude * np.sin(2.0 * np.pi * frequency * flow.control_period * np.arange(steps))
    return signal


def exploration(steps: int, forcing: ForcingConfig, flow: FlowConfig, rng: np.random.Generator, *, rms: float) -> Array:
    """Compute coloured noise to add to a controller's commands; shape (steps,), in U_inf W. The noise is an
    Ornstein-Uhlenbeck process: Gaussian, stationary from the first step on, with autocorrelation exp(-lag /
    `exploration_time`). With equal seeds, a longer signal begins with the shorter signal. The noise is not clipped;
    the sum of command and noise is clipped later. `rms` is a fraction of the action limit."""
    kept = np.exp(-flow.control_period / forcing.exploration_time)
    white = rng.standard_normal(steps)
    white[1:] *= np.sqrt(1.0 - kept**2)
    signal: Array = rms * flow.action_limit * lfilter([1.0], [1.0, -kept], white)
    return signal


def _sweep(steps: int, start: float, end: float, flow: FlowConfig) -> Array:
    t = np.arange(steps) * flow.control_period
    rate = (end - start) / (max(steps, 1) * flow.control_period)
    return flow.action_limit * np.sin(2.0 * np.pi * (start * t + 0.5 * rate * t**2))


Signal = Callable[[int, ForcingConfig, FlowConfig, np.random.Generator], Array]
SIGNALS: Final[dict[ForcingName, Signal]] = {
    "training": training,
    "chirp": lambda steps, forcing, flow, _: _sweep(steps, forcing.chirp_start, forcing.chirp_end, flow),
    "extended_chirp": lambda steps, forcing, flow, _: _sweep(
        steps, forcing.extended_chirp_start, forcing.extended_chirp_end, flow
    ),
    "none": lambda steps, *_: np.zeros(steps),
}


_ROLES: Final[dict[ForcingName, Role]] = {
    "training": "train",
    "none": "train",
    "chirp": "test",
    "extended_chirp": "extended",
}
SHEDDING_PERIOD: Final = 24
"""Shedding period of the uncontrolled wake in control steps (Strouhal number 0.207)."""


@dataclass(frozen=True, kw_only=True)
class EpisodePlan:
    """The plan of one episode with open-loop forcing. `lead` is the number of control steps without forcing from the
    start to the first sample. It differs, so that episodes begin in different phases of the shedding cycle."""

    forcing: ForcingName
    steps: int
    seed: int
    lead: int = 0
    packages: ClassVar[tuple[str, ...]] = ()
    """Packages whose versions affect the samples, besides the packages of the flow solver."""

    @property
    def role(self) -> Role:
        """The use of the episode. The paper trains on "training" and "none", and tests on the chirps (appendix A)."""
        return _ROLES[self.forcing]

    @property
    def name(self) -> str:
        return f"{self.forcing}_{self.seed}"

    @property
    def provenance(self) -> dict[str, Any]:
        """The plan's entries for the episode's provenance in the data set, as plain JSON."""
        return {"forcing_signal": self.forcing, "seed": self.seed, "lead_steps": self.lead}

    def signal(self, config: Config) -> npt.NDArray[np.float64]:
        """Return the signal that is added to the policy's command at every control step, (steps,), in U_inf W."""
        return SIGNALS[self.forcing](self.steps, config.forcing, config.flow, np.random.default_rng(self.seed))


def paper_plans(seed: int = 1) -> tuple[EpisodePlan, ...]:
    """Return the plans of the paper's data set (section 2.1, appendix A): 50,000 forced and 2,500 unforced training
    steps, 10,000 steps of the chirp, and 10,000 of the extended chirp. The training steps are split into independent
    episodes with seeds `seed`, `seed` + 1, ... The episodes start at phases spread evenly over a shedding cycle, so
    that they differ in more than the forcing. A chirp cannot be split."""
    training = (
        EpisodePlan(forcing="training", steps=5_000, seed=seed + i, lead=round(SHEDDING_PERIOD * i / 10))
        for i in range(10)
    )
    return (
        *training,
        EpisodePlan(forcing="none", steps=2_500, seed=0),
        EpisodePlan(forcing="chirp", steps=10_000, seed=0),
        EpisodePlan(forcing="extended_chirp", steps=10_000, seed=0),
    )


ControlledRole = Literal["train", "controlled"]
CalmRole = Literal["train", "calm"]


@dataclass(frozen=True, kw_only=True)
class RoundPlan:
    """The plan of one episode of a round. Its kind is "controlled" for an episode from the developed wake, "calm" for
    an episode from the steady wake; its role is "train" or, for a held-out episode, the kind. Rounds are numbered from
    1, the episodes of a round from 0. `level` is the rms of the random action, which is added to the commands if there
    is a controller: a fraction of the action limit or, for a calm episode, in U_inf W. Seed, round, episode and role
    determine the random action. `lead` is as in `EpisodePlan`. Without a controller, `bundle` is None."""

    kind: Literal["controlled", "calm"]
    round: int
    episode: int
    steps: int
    level: float
    role: Literal["train", "controlled", "calm"]
    seed: int
    lead: int
    bundle: str | None
    bundle_digest: str | None
    packages: ClassVar[tuple[str, ...]] = ("onnxruntime",)

    @property
    def name(self) -> str:
        return f"{self.kind}_{self.round}_{self.episode}"

    @property
    def provenance(self) -> dict[str, Any]:
        return {
            "forcing_signal": self.kind,
            "round": self.round,
            "episode": self.episode,
            "bundle": self.bundle,
            "bundle_digest": self.bundle_digest,
            "amplitude" if self.kind == "calm" else "exploration": self.level,
            "seed": self.seed,
            "lead_steps": self.lead,
        }

    def signal(self, config: Config) -> npt.NDArray[np.float64]:
        """Return the random action at every control step, (steps,), in U_inf W."""
        rng = np.random.default_rng([self.seed, self.round, int(self.role != "train"), self.episode])
        rms = self.level / config.flow.action_limit if self.kind == "calm" else self.level
        return exploration(self.steps, config.forcing, config.flow, rng, rms=rms)


Plan = EpisodePlan | RoundPlan
"""The plan of one episode. No two plans of a recording are equal."""


@dataclass(frozen=True, kw_only=True)
class ControlledRound:
    """A round of `episodes` episodes of `steps` steps under a controller. `exploration` is the field `level` of
    `RoundPlan`; all other fields are as in `RoundPlan`. Raises ConfigError for a number out of its range or an invalid
    role."""

    episodes: int = 2
    steps: int = 1100
    exploration: float = 0.15
    role: ControlledRole = "train"
    seed: int = 1
    bundle: str
    bundle_digest: str

    def __post_init__(self) -> None:
        _check(self, get_args(ControlledRole), {"episodes": 1, "steps": 1, "seed": 0, "exploration": 0.0})

    def plans(self, number: int) -> tuple[RoundPlan, ...]:
        """Return the plans of round `number`. Seed, round and role determine the random phases of the shedding cycle in
        which the episodes begin. Phases repeat only if there are more episodes than control steps in the cycle."""
        rng = np.random.default_rng([self.seed, number, get_args(ControlledRole).index(self.role)])
        leads = rng.permutation(SHEDDING_PERIOD).tolist()
        lead_of = [leads[i % SHEDDING_PERIOD] for i in range(self.episodes)]
        return tuple(_plan(self, number, i, self.exploration, lead) for i, lead in enumerate(lead_of))


@dataclass(frozen=True, kw_only=True)
class CalmRound:
    """A round of `episodes` calm episodes of `steps` steps. The amplitudes of the episodes are spaced evenly on a
    logarithmic scale from `smallest` to `largest`; a single episode has the smallest amplitude. The other fields are as
    in `RoundPlan`. Raises ConfigError for a number out of its range or an invalid role."""

    episodes: int = 8
    steps: int = 350
    smallest: float = 0.0005
    largest: float = 0.02
    role: CalmRole = "train"
    seed: int = 1
    bundle: str | None = None
    bundle_digest: str | None = None

    def __post_init__(self) -> None:
        _check(self, get_args(CalmRole), {"episodes": 1, "steps": 1, "seed": 0})
        for name, value in (("smallest", self.smallest), ("largest", self.largest)):
            # With an action of exactly zero, only rounding errors would disturb the wake.
            if not (isfinite(value) and value > 0.0):
                raise ConfigError(f"{name} amplitude = {value}: must be finite and positive")
        if self.smallest > self.largest:
            raise ConfigError(f"smallest amplitude = {self.smallest}: must not exceed the largest, {self.largest}")

    def plans(self, number: int) -> tuple[RoundPlan, ...]:
        """Return the plans of round `number`."""
        amplitudes = np.geomspace(self.smallest, self.largest, self.episodes)
        return tuple(_plan(self, number, i, float(level), 0) for i, level in enumerate(amplitudes))


def _plan(wanted: ControlledRound | CalmRound, number: int, episode: int, level: float, lead: int) -> RoundPlan:
    kind: Literal["controlled", "calm"] = "calm" if isinstance(wanted, CalmRound) else "controlled"
    own = {name: getattr(wanted, name) for name in ("steps", "role", "seed", "bundle", "bundle_digest")}
    return RoundPlan(kind=kind, round=number, episode=episode, level=level, lead=lead, **own)


def _check(wanted: ControlledRound | CalmRound, roles: tuple[Any, ...], least: Mapping[str, float]) -> None:
    for name, bound in least.items():
        value = getattr(wanted, name)
        if not (isfinite(value) and value >= bound):
            raise ConfigError(f"{name} = {value}: must be finite and at least {bound}")
    if wanted.role not in roles:
        raise ConfigError(f"role = {wanted.role!r}: must be one of {', '.join(roles)}")
