"""Which episodes are recorded under a controller (DAgger: Ross, Gordon and Bagnell 2011, a data set that grows by what
the controller of the round before runs into)."""

from dataclasses import dataclass
from math import isfinite
from typing import Any, ClassVar, Final, Literal, get_args

import numpy as np
import numpy.typing as npt

from contract.config.tree import Config
from contract.errors import ConfigError
from wake.recording.episode_plan import SHEDDING_PERIOD
from wake.recording.forcing import exploration

ControlledRole = Literal["train", "controlled"]
_ROLES: Final[tuple[str, ...]] = get_args(ControlledRole)


@dataclass(frozen=True, kw_only=True)
class ControlledPlan:
    """One episode under a controller with exploration.

    Attributes:
        round: which addition to the data set it belongs to, from 1.
        episode: its number in the round, from 0.
        exploration: rms of what is added to the commands, as a fraction of the action limit.
        role: "train", or "controlled" to hold it out.
        seed: with round, episode and role it fixes the exploration; so no two rounds repeat one another.
        lead: control steps without forcing from the developed start to the first sample.
        bundle, bundle_digest: whose controller it is.
    """

    round: int
    episode: int
    steps: int
    exploration: float
    role: ControlledRole
    seed: int
    lead: int
    bundle: str
    bundle_digest: str
    packages: ClassVar[tuple[str, ...]] = ("onnxruntime",)
    """Packages that decide the samples as well as those of the flow solver."""

    @property
    def name(self) -> str:
        return f"controlled_{self.round}_{self.episode}"

    @property
    def provenance(self) -> dict[str, Any]:
        """What the data set keeps of the plan, as plain JSON."""
        return {
            "forcing_signal": "controlled",
            "round": self.round,
            "episode": self.episode,
            "bundle": self.bundle,
            "bundle_digest": self.bundle_digest,
            "exploration": self.exploration,
            "seed": self.seed,
            "lead_steps": self.lead,
        }

    def signal(self, config: Config) -> npt.NDArray[np.float64]:
        """The exploration at every control step, (steps,), in U_inf W."""
        rng = np.random.default_rng([self.seed, self.round, _ROLES.index(self.role), self.episode])
        return exploration(self.steps, config.forcing, config.flow, rng, rms=self.exploration)


@dataclass(frozen=True, kw_only=True)
class ControlledRound:
    """What one call adds: `episodes` episodes of `steps` steps; the rest as in `ControlledPlan`.

    Raises ConfigError for a number out of its range or a role that does not fit.
    """

    episodes: int = 2
    steps: int = 1100
    exploration: float = 0.15
    role: ControlledRole = "train"
    seed: int = 1
    bundle: str
    bundle_digest: str

    def __post_init__(self) -> None:
        for name, least in (("episodes", 1), ("steps", 1), ("seed", 0), ("exploration", 0.0)):
            value = getattr(self, name)
            if not (isfinite(value) and value >= least):
                raise ConfigError(f"{name} = {value}: must be finite and at least {least}")
        if self.role not in _ROLES:
            raise ConfigError(f"role = {self.role!r}: must be one of {', '.join(_ROLES)}")

    def plans(self, number: int) -> tuple[ControlledPlan, ...]:
        """The episodes of round `number`. They begin in different phases of the shedding cycle, drawn by seed, round
        and role; only the phases of more episodes than it has control steps repeat."""
        rng = np.random.default_rng([self.seed, number, _ROLES.index(self.role)])
        leads = rng.permutation(SHEDDING_PERIOD)
        return tuple(
            ControlledPlan(
                round=number,
                episode=i,
                steps=self.steps,
                exploration=self.exploration,
                role=self.role,
                seed=self.seed,
                lead=int(leads[i % SHEDDING_PERIOD]),
                bundle=self.bundle,
                bundle_digest=self.bundle_digest,
            )
            for i in range(self.episodes)
        )
