"""What a run is worth to the search: the drag that it takes off, less a penalty for side force and for trouble."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any, Final

from contract.errors import ConfigError

TROUBLE: Final = -100.0
"""Score of settings with which control was not held, or the flow diverged: worse than any loop that ran."""


@dataclass(frozen=True, kw_only=True)
class PhaseFigures:
    """What one run measured; figures that do not exist are None.

    Attributes:
        reduction_percent: of the wall's mean drag; None unless control was held while averaged.
        abs_Cl, mean_Cl, rms_action, jet_power: under control.
        trouble: why control was not held, as a sentence; None if it was.
    """

    reduction_percent: float | None
    abs_Cl: float | None
    mean_Cl: float | None
    rms_action: float | None
    jet_power: float | None
    Cd_net_reduction_percent: float | None = None
    trouble: str | None = None

    @classmethod
    def of(cls, summary: Mapping[str, Any]) -> "PhaseFigures":
        """From `firmware_sim.runs.summary.summary`."""
        before, under = summary["Cd_net_uncontrolled"], summary["Cd_net_controlled"]
        return cls(
            reduction_percent=summary["reduction_percent"],
            abs_Cl=summary["abs_Cl_controlled"],
            mean_Cl=summary["mean_Cl_controlled"],
            rms_action=summary["rms_action"],
            jet_power=summary["jet_power_controlled"],
            Cd_net_reduction_percent=None if before is None or under is None else 100.0 * (1.0 - under / before),
            trouble=summary["trouble"],
        )

    @classmethod
    def failed(cls, why: str) -> "PhaseFigures":
        """Figures of a run that did not end."""
        return cls(reduction_percent=None, abs_Cl=None, mean_Cl=None, rms_action=None, jet_power=None, trouble=why)

    def to_tree(self) -> dict[str, Any]:
        """As plain JSON."""
        return asdict(self)


@dataclass(frozen=True, kw_only=True)
class Goal:
    """How runs are scored, in percentage points of drag reduction.

    Attributes:
        lift_bound: mean |Cl| up to which side force costs nothing.
        lift_penalty: points for each unit of mean |Cl| above the bound.

    Raises:
        ConfigError: for a bound or a penalty that is no number, or negative.
    """

    lift_bound: float = 0.2
    lift_penalty: float = 100.0

    def __post_init__(self) -> None:
        for name in ("lift_bound", "lift_penalty"):
            value = getattr(self, name)
            if not (isfinite(value) and value >= 0.0):
                raise ConfigError(f"--{name.replace('_', '-')} {value}: must be a number, at least 0")

    def points(self, reduction_percent: float, abs_Cl: float) -> float:
        """The score of a reduction with this mean |Cl|."""
        return reduction_percent - self.lift_penalty * max(0.0, abs_Cl - self.lift_bound)

    def score(self, figures: PhaseFigures) -> float:
        """Score of a run."""
        if figures.trouble is not None or figures.reduction_percent is None or figures.abs_Cl is None:
            return TROUBLE
        return self.points(figures.reduction_percent, figures.abs_Cl)

    def score_of_all(self, runs: Sequence[PhaseFigures]) -> float:
        """Mean over the phases; of trouble in one of them, `TROUBLE`."""
        scores = [self.score(run) for run in runs]
        return TROUBLE if not scores or TROUBLE in scores else sum(scores) / len(scores)
