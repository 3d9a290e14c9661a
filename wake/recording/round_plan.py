"""The rounds of episodes that are added to a data set. They run under a controller or from the steady wake.

A round under a controller adds the flow states that the controller of the last round reaches (DAgger: Ross, Gordon and
Bagnell 2011). Calm episodes begin at the steady wake. Small random actions disturb this wake, and the disturbances grow
up to shedding. The amplitude of the actions differs between episodes. A model that is trained without calm episodes
predicts a wrong growth, because no other episode comes near the steady wake.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any, ClassVar, Literal, get_args

import numpy as np
import numpy.typing as npt

from contract.config.tree import Config
from contract.errors import ConfigError
from wake.recording.episode_plan import SHEDDING_PERIOD, EpisodePlan, exploration

ControlledRole = Literal["train", "controlled"]
CalmRole = Literal["train", "calm"]


@dataclass(frozen=True, kw_only=True)
class RoundPlan:
    """The plan of one episode of a round.

    Attributes:
        kind: "controlled" for an episode from the developed wake, "calm" for an episode from the steady wake. This word
            is also the role of a held-out episode.
        round: number of the addition to the data set, from 1.
        episode: number of the episode in the round, from 0.
        level: rms of the random action, which is added to the commands if there is a controller. It is a fraction of
            the action limit; for a calm episode it is in U_inf W.
        role: "train" or, for a held-out episode, the kind.
        seed: random seed. The seed, round, episode and role determine the random action, so that rounds differ.
        lead: number of control steps without forcing from the start to the first sample.
        bundle, bundle_digest: bundle of the controller, and its digest; None without a controller.
    """

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
"""The plan of one episode. All plans of a recording have different field values."""


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
        """Return the plans of round `number`. Their episodes begin in random phases of the shedding cycle, which follow
        from seed, round and role. Phases repeat only if there are more episodes than control steps in the cycle."""
        rng = np.random.default_rng([self.seed, number, get_args(ControlledRole).index(self.role)])
        leads = rng.permutation(SHEDDING_PERIOD)
        places = ((self.exploration, int(leads[i % SHEDDING_PERIOD])) for i in range(self.episodes))
        return tuple(_plan(self, "controlled", number, i, *place) for i, place in enumerate(places))


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
        return tuple(_plan(self, "calm", number, i, float(level), 0) for i, level in enumerate(amplitudes))


def _plan(
    wanted: ControlledRound | CalmRound,
    kind: Literal["controlled", "calm"],
    number: int,
    episode: int,
    level: float,
    lead: int,
) -> RoundPlan:
    own = {name: getattr(wanted, name) for name in ("steps", "role", "seed", "bundle", "bundle_digest")}
    return RoundPlan(kind=kind, round=number, episode=episode, level=level, lead=lead, **own)


def _check(wanted: ControlledRound | CalmRound, roles: tuple[Any, ...], least: Mapping[str, float]) -> None:
    for name, bound in least.items():
        value = getattr(wanted, name)
        if not (isfinite(value) and value >= bound):
            raise ConfigError(f"{name} = {value}: must be finite and at least {bound}")
    if wanted.role not in roles:
        raise ConfigError(f"role = {wanted.role!r}: must be one of {', '.join(roles)}")
