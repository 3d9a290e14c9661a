"""What every episode's plan holds, whether its jets are forced or under a controller."""

from dataclasses import Field
from typing import Any, ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from contract.config.tree import Config
from contract.recording.dataset import Role


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
