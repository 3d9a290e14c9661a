"""Which episodes a recording consists of."""

from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np
import numpy.typing as npt

from contract.config.tree import Config
from contract.recording.dataset import Role
from wake.recording.forcing import SIGNALS, ForcingName

_ROLES: Final[dict[ForcingName, Role]] = {
    "training": "train",
    "none": "train",
    "chirp": "test",
    "extended_chirp": "extended",
}
_PAPER_TRAINING_EPISODES: Final = 10
SHEDDING_PERIOD: Final = 24
"""Shedding period of the uncontrolled wake in control steps (Strouhal number 0.207)."""


@dataclass(frozen=True, kw_only=True)
class EpisodePlan:
    """One episode to record.

    Attributes:
        lead: control steps without forcing from the developed start to the first sample, so that episodes begin in
            different phases of the shedding cycle.
    """

    forcing: ForcingName
    steps: int
    seed: int
    lead: int = 0
    packages: ClassVar[tuple[str, ...]] = ()
    """Packages that decide the samples as well as those of the flow solver."""

    @property
    def role(self) -> Role:
        """The paper tests on the chirp and trains on the rest; its appendix A adds the extended chirp."""
        return _ROLES[self.forcing]

    @property
    def name(self) -> str:
        return f"{self.forcing}_{self.seed}"

    @property
    def provenance(self) -> dict[str, Any]:
        """What the data set keeps of the plan, as plain JSON."""
        return {"forcing_signal": self.forcing, "seed": self.seed, "lead_steps": self.lead}

    def signal(self, config: Config) -> npt.NDArray[np.float64]:
        """Actions of every control step, (steps,), in U_inf W."""
        return SIGNALS[self.forcing](self.steps, config.forcing, config.flow, np.random.default_rng(self.seed))


def paper_plans(seed: int = 1) -> tuple[EpisodePlan, ...]:
    """The paper's data set (section 2.1, appendix A): 50,000 + 2,500 steps to train on, 10,000 of the chirp, 10,000 of
    the extended chirp.

    The training steps are split into independent episodes with seeds `seed`, `seed` + 1, ... that start at phases
    spread evenly over a shedding cycle: they can be recorded side by side, and differ in more than their forcing.
    A chirp cannot be split, because its duration decides how fast it sweeps.
    """
    count = _PAPER_TRAINING_EPISODES
    training = (
        EpisodePlan(forcing="training", steps=50_000 // count, seed=seed + i, lead=round(SHEDDING_PERIOD * i / count))
        for i in range(count)
    )
    return (
        *training,
        EpisodePlan(forcing="none", steps=2_500, seed=0),
        EpisodePlan(forcing="chirp", steps=10_000, seed=0),
        EpisodePlan(forcing="extended_chirp", steps=10_000, seed=0),
    )
