"""Which episodes are recorded under a controller (DAgger: Ross, Gordon and Bagnell 2011, a data set that grows by what
the controller of the round before runs into)."""

from dataclasses import dataclass
from math import isfinite
from typing import Final, Literal, get_args

import numpy as np

from contract.errors import ConfigError
from wake.recording.episode_plan import SHEDDING_PERIOD
from wake.recording.round_plan import RoundPlan

ControlledRole = Literal["train", "controlled"]
_ROLES: Final[tuple[str, ...]] = get_args(ControlledRole)


@dataclass(frozen=True, kw_only=True)
class ControlledRound:
    """What one call adds: `episodes` episodes of `steps` steps; the rest as in `RoundPlan`. Raises ConfigError for a
    number out of its range or a role that does not fit."""

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

    def plans(self, number: int) -> tuple[RoundPlan, ...]:
        """The episodes of round `number`. They begin in different phases of the shedding cycle, drawn by seed, round
        and role; only the phases of more episodes than it has control steps repeat."""
        rng = np.random.default_rng([self.seed, number, _ROLES.index(self.role)])
        leads = rng.permutation(SHEDDING_PERIOD)
        return tuple(
            RoundPlan(
                kind="controlled",
                round=number,
                episode=i,
                steps=self.steps,
                level=self.exploration,
                role=self.role,
                seed=self.seed,
                lead=int(leads[i % SHEDDING_PERIOD]),
                bundle=self.bundle,
                bundle_digest=self.bundle_digest,
            )
            for i in range(self.episodes)
        )
