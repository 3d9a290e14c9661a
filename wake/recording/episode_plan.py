"""Plans of episodes: the common interface, and the episodes of a forced recording."""

from dataclasses import Field, dataclass
from typing import Any, ClassVar, Final, Protocol

import numpy as np
import numpy.typing as npt

from contract.config.tree import Config
from contract.recording.dataset import Role
from wake.recording.forcing import SIGNALS, ForcingName


class Plan(Protocol):
    """The plan of one episode: a dataclass. No two plans of a recording have equal field values."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    packages: ClassVar[tuple[str, ...]]
    """Packages, in addition to the flow solver's, whose versions affect the samples."""

    @property
    def name(self) -> str:
        """Name of the episode in the data set."""

    @property
    def role(self) -> Role:
        """The use of the episode: training or a test."""

    @property
    def steps(self) -> int:
        """Number of control steps."""

    @property
    def lead(self) -> int:
        """Number of control steps without forcing from the developed start to the first sample."""

    @property
    def provenance(self) -> dict[str, Any]:
        """The plan's entries in the provenance that the data set stores, as plain JSON."""

    def signal(self, config: Config) -> npt.NDArray[np.float64]:
        """Return the signal that is added to the policy's command at every control step, (steps,), in U_inf W."""


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
    """The plan of one episode with open-loop forcing.

    Attributes:
        lead: number of control steps without forcing before the first sample. The numbers of the episodes differ, so
            that the episodes begin in different phases of the shedding cycle.
    """

    forcing: ForcingName
    steps: int
    seed: int
    lead: int = 0
    packages: ClassVar[tuple[str, ...]] = ()
    """Packages, in addition to the flow solver's, whose versions affect the samples."""

    @property
    def role(self) -> Role:
        """The episode's role. The paper tests on the chirp and trains on the other episodes; its appendix A also tests
        on the extended chirp."""
        return _ROLES[self.forcing]

    @property
    def name(self) -> str:
        return f"{self.forcing}_{self.seed}"

    @property
    def provenance(self) -> dict[str, Any]:
        """The plan's entries in the provenance that the data set stores, as plain JSON."""
        return {"forcing_signal": self.forcing, "seed": self.seed, "lead_steps": self.lead}

    def signal(self, config: Config) -> npt.NDArray[np.float64]:
        """Return the action of every control step, (steps,), in U_inf W."""
        return SIGNALS[self.forcing](self.steps, config.forcing, config.flow, np.random.default_rng(self.seed))


def paper_plans(seed: int = 1) -> tuple[EpisodePlan, ...]:
    """Return the plans of the paper's data set (section 2.1, appendix A): 50,000 + 2,500 steps for training, 10,000 of
    the chirp, 10,000 of the extended chirp.

    The training steps are split into independent episodes with seeds `seed`, `seed` + 1, ... that start at phases
    spread evenly over a shedding cycle. So the episodes can be recorded in parallel, and differ in more than the
    forcing. A chirp cannot be split, because its sweep rate depends on its duration.
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
