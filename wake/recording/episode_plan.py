"""Plans of the episodes of a forced recording."""

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
    """The plan of one episode with open-loop forcing. `lead` is the number of control steps without forcing from the
    start to the first sample; it differs between episodes, so that they begin in different phases of the shedding
    cycle."""

    forcing: ForcingName
    steps: int
    seed: int
    lead: int = 0
    packages: ClassVar[tuple[str, ...]] = ()
    """Packages, in addition to the flow solver's, whose versions affect the samples."""

    @property
    def role(self) -> Role:
        """The use of the episode. The paper tests on the chirp and trains on the other episodes; its appendix A also
        tests on the extended chirp."""
        return _ROLES[self.forcing]

    @property
    def name(self) -> str:
        return f"{self.forcing}_{self.seed}"

    @property
    def provenance(self) -> dict[str, Any]:
        """The plan's entries in the provenance that the data set stores, as plain JSON."""
        return {"forcing_signal": self.forcing, "seed": self.seed, "lead_steps": self.lead}

    def signal(self, config: Config) -> npt.NDArray[np.float64]:
        """Return the signal that is added to the policy's command at every control step, (steps,), in U_inf W."""
        return SIGNALS[self.forcing](self.steps, config.forcing, config.flow, np.random.default_rng(self.seed))


def paper_plans(seed: int = 1) -> tuple[EpisodePlan, ...]:
    """Return the plans of the paper's data set (section 2.1, appendix A): 50,000 + 2,500 steps for training, 10,000 of
    the chirp, 10,000 of the extended chirp. The training steps are split into independent episodes with seeds `seed`,
    `seed` + 1, ... that start at phases spread evenly over a shedding cycle, so that they differ in more than the
    forcing. A chirp cannot be split, because its sweep rate depends on its duration."""
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
