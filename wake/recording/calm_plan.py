"""Which episodes begin at the steady symmetric wake.

Forced or controlled episodes of the developed wake never come near it: what a model learns from them does not hold for
how small disturbances grow there. These episodes are disturbed by small random actions, each by another amplitude, and
show the wake on its way up to shedding.
"""

from dataclasses import dataclass
from math import isfinite
from typing import Any, ClassVar, Final, Literal, get_args

import numpy as np
import numpy.typing as npt

from contract.config.tree import Config
from contract.errors import ConfigError
from wake.recording.forcing import exploration

CalmRole = Literal["train", "calm"]
_ROLES: Final[tuple[str, ...]] = get_args(CalmRole)


@dataclass(frozen=True, kw_only=True)
class CalmPlan:
    """One episode that begins at the steady wake.

    Attributes:
        round: which addition to the data set it belongs to, from 1.
        episode: its number in the round, from 0.
        amplitude: rms of the random action, in U_inf W; it is added to the controller's commands, if there is one.
        role: "train", or "calm" to hold it out.
        seed: with round, episode and role it fixes the random action; so no two rounds repeat one another.
        bundle, bundle_digest: whose controller it is; None without one.
    """

    round: int
    episode: int
    steps: int
    amplitude: float
    role: CalmRole
    seed: int
    bundle: str | None = None
    bundle_digest: str | None = None
    packages: ClassVar[tuple[str, ...]] = ("onnxruntime",)
    """Packages that decide the samples as well as those of the flow solver."""

    @property
    def name(self) -> str:
        return f"calm_{self.round}_{self.episode}"

    @property
    def lead(self) -> int:
        """None: every sample from the steady wake on is kept."""
        return 0

    @property
    def provenance(self) -> dict[str, Any]:
        """What the data set keeps of the plan, as plain JSON."""
        return {
            "forcing_signal": "calm",
            "round": self.round,
            "episode": self.episode,
            "bundle": self.bundle,
            "bundle_digest": self.bundle_digest,
            "amplitude": self.amplitude,
            "seed": self.seed,
            "lead_steps": self.lead,
        }

    def signal(self, config: Config) -> npt.NDArray[np.float64]:
        """The random action at every control step, (steps,), in U_inf W."""
        rng = np.random.default_rng([self.seed, self.round, _ROLES.index(self.role), self.episode])
        rms = self.amplitude / config.flow.action_limit
        return exploration(self.steps, config.forcing, config.flow, rng, rms=rms)


@dataclass(frozen=True, kw_only=True)
class CalmRound:
    """What one call adds: `episodes` episodes of `steps` steps, whose amplitudes are spread evenly by their logarithm
    from `smallest` to `largest`; one episode alone has the smallest. The rest as in `CalmPlan`.

    Raises ConfigError for a number out of its range or a role that does not fit.
    """

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

    def plans(self, number: int) -> tuple[CalmPlan, ...]:
        """The episodes of round `number`."""
        return tuple(
            CalmPlan(
                round=number,
                episode=i,
                steps=self.steps,
                amplitude=float(amplitude),
                role=self.role,
                seed=self.seed,
                bundle=self.bundle,
                bundle_digest=self.bundle_digest,
            )
            for i, amplitude in enumerate(np.geomspace(self.smallest, self.largest, self.episodes))
        )
