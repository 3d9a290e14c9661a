"""Which episodes begin at the steady symmetric wake.

Forced or controlled episodes of the developed wake never come near it: what a model learns from them does not hold for
how small disturbances grow there. These episodes are disturbed by small random actions, each by another amplitude, and
show the wake on its way up to shedding.
"""

from dataclasses import dataclass
from math import isfinite
from typing import Final, Literal, get_args

import numpy as np

from contract.errors import ConfigError
from wake.recording.round_plan import RoundPlan

CalmRole = Literal["train", "calm"]
_ROLES: Final[tuple[str, ...]] = get_args(CalmRole)


@dataclass(frozen=True, kw_only=True)
class CalmRound:
    """What one call adds: `episodes` episodes of `steps` steps, whose amplitudes are spread evenly by their logarithm
    from `smallest` to `largest`; one episode alone has the smallest. The rest as in `RoundPlan`. Raises ConfigError for
    a number out of its range or a role that does not fit."""

    episodes: int = 8
    steps: int = 350
    smallest: float = 0.0005
    largest: float = 0.02
    role: CalmRole = "train"
    seed: int = 1
    bundle: str | None = None
    bundle_digest: str | None = None

    def __post_init__(self) -> None:
        for name, least in (("episodes", 1), ("steps", 1), ("seed", 0)):
            value = getattr(self, name)
            if value < least:
                raise ConfigError(f"{name} = {value}: must be at least {least}")
        for name, value in (("smallest", self.smallest), ("largest", self.largest)):
            # Exactly nothing would leave the wake as it is: only rounding would disturb it.
            if not (isfinite(value) and value > 0.0):
                raise ConfigError(f"{name} amplitude = {value}: must be finite and positive")
        if self.smallest > self.largest:
            raise ConfigError(f"smallest amplitude = {self.smallest}: must not exceed the largest, {self.largest}")
        if self.role not in _ROLES:
            raise ConfigError(f"role = {self.role!r}: must be one of {', '.join(_ROLES)}")

    def plans(self, number: int) -> tuple[RoundPlan, ...]:
        """The episodes of round `number`."""
        return tuple(
            RoundPlan(
                kind="calm",
                round=number,
                episode=i,
                steps=self.steps,
                level=float(amplitude),
                role=self.role,
                seed=self.seed,
                lead=0,
                bundle=self.bundle,
                bundle_digest=self.bundle_digest,
            )
            for i, amplitude in enumerate(np.geomspace(self.smallest, self.largest, self.episodes))
        )
