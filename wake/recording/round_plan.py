"""One episode of a round: under a controller with exploration, or from the steady wake under small random actions."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from contract.config.tree import Config
from wake.recording.forcing import exploration


@dataclass(frozen=True, kw_only=True)
class RoundPlan:
    """One episode to record.

    Attributes:
        kind: "controlled" from the developed wake, "calm" from the steady one; also the role of what is held out.
        round: which addition to the data set it belongs to, from 1.
        episode: its number in the round, from 0.
        level: rms of the random action that is added to the controller's commands, if there is one: as a fraction of
            the action limit, and of a calm episode in U_inf W.
        role: "train", or the kind to hold it out.
        seed: with round, episode and role it fixes the random action; so no two rounds repeat one another.
        lead: control steps without forcing from the start to the first sample.
        bundle, bundle_digest: whose controller it is; None without one.
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
    """Packages that decide the samples as well as those of the flow solver."""

    @property
    def name(self) -> str:
        return f"{self.kind}_{self.round}_{self.episode}"

    @property
    def provenance(self) -> dict[str, Any]:
        """What the data set keeps of the plan, as plain JSON."""
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
        """The random action at every control step, (steps,), in U_inf W."""
        rng = np.random.default_rng([self.seed, self.round, int(self.role != "train"), self.episode])
        rms = self.level / config.flow.action_limit if self.kind == "calm" else self.level
        return exploration(self.steps, config.forcing, config.flow, rng, rms=rms)
