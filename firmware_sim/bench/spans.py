"""How long a run goes on: without control, with it, and what its averages leave out."""

from dataclasses import dataclass
from typing import Final

from contract.errors import StillwakeError

SHEDDING_TIME: Final = 5.0
"""t_c: a shedding cycle of the truck's wake, by its Strouhal number of 0.2."""
_LONGEST: Final = 1e6
"""t_c: a run of a day."""
CYCLES: Final = 2
"""A span of two cycles holds a whole one wherever in a cycle it begins."""


@dataclass(frozen=True, kw_only=True)
class Spans:
    """A run's spans in t_c, checked before it starts. Raises StillwakeError if a span is not a number of t_c, or too
    short for averages where they are asked for.

    Attributes:
        lead_in: without control; the controller's window fills meanwhile.
        settle: after the request, left out of the controlled averages.
    """

    lead_in: float
    controlled: float
    settle: float
    averages: bool = True

    def __post_init__(self) -> None:
        for name in ("lead_in", "controlled", "settle"):
            value = getattr(self, name)
            if not 0.0 <= value <= _LONGEST:
                raise StillwakeError(f"{_option(name)} = {value}: must be a number of t_c in 0..{_LONGEST:g}")
        if not self.averages:
            return
        least = CYCLES * SHEDDING_TIME
        remedy = f"must be at least {least:g} t_c, {CYCLES} shedding cycles, for averages; without them: --no-averages"
        if self.lead_in < least:
            raise StillwakeError(f"{_option('lead_in')} = {self.lead_in:g}: {remedy}")
        if round(self.controlled - self.settle, 9) < least:
            raise StillwakeError(
                f"{_option('controlled')} = {self.controlled:g} less {_option('settle')} = {self.settle:g} leaves "
                f"{self.controlled - self.settle:g} t_c: {remedy}"
            )

    def periods(self, control_period: float) -> tuple[int, int]:
        """Control periods without control, and in all. Raises StillwakeError if a span is shorter than a control
        period."""
        counts = []
        for name in ("lead_in", "controlled"):
            counts.append(round(getattr(self, name) / control_period))
            if counts[-1] < 1:
                raise StillwakeError(
                    f"{_option(name)} = {getattr(self, name):g}: shorter than a control period of {control_period:g}"
                )
        return counts[0], sum(counts)


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")
