"""Plans of episodes: what every one holds, and which ones a forced recording consists of."""

from dataclasses import Field, dataclass
from typing import Any, ClassVar, Final, Protocol

import numpy as np
import numpy.typing as npt

from contract.config.tree import Config
from contract.recording.dataset import Role
from wake.recording.forcing import SIGNALS, ForcingName


class Plan(Protocol):
    """One episode to record; a dataclass whose fields no other one of the recording shares."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    packages: ClassVar[tuple[str, ...]]
    """Packages that decide the samples as well as those of the flow solver."""

    @property
    def name(self) -> str:
        """Name of the episode in the data set."""

    @property
    def role(self) -> Role:
        """What the episode is used for."""

    @property
    def steps(self) -> int:
        """Control steps."""

    @property
    def lead(self) -> int:
        """Control steps without forcing from the developed start to the first sample."""

    @property
    def provenance(self) -> dict[str, Any]:
        """What the data set keeps of the plan, as plain JSON."""

    def signal(self, config: Config) -> npt.NDArray[np.float64]:
        """What is added to the policy's command at every control step, (steps,), in U_inf W."""


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
