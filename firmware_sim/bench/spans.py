"""The lengths of a run's parts: without control, under control, and the part that averages under control leave out."""

from dataclasses import dataclass
from typing import Final

from contract.errors import StillwakeError

SHEDDING_TIME: Final = 5.0
"""Length in t_c of a shedding cycle of the truck's wake, from its Strouhal number of 0.2."""
_LONGEST: Final = 1e6
"""Longest span in t_c, about a day of the run's time."""
CYCLES: Final = 2
"""Smallest number of shedding cycles in an averaged span, so that the span contains a whole cycle in any phase."""


@dataclass(frozen=True, kw_only=True)
class Spans:
    """Lengths of a run's spans in t_c. Raises StillwakeError if a span is negative, not finite or longer than 10^6 t_c,
    or, with `averages`, too short for averages.

    Attributes:
        lead_in: time without control, in which the controller's window fills.
        settle: time after the request for control that the averages under control leave out.
    """

    lead_in: float
    controlled: float
    settle: float
    averages: bool = True

    def __post_init__(self) -> None:
        for name in ("lead_in", "controlled", "settle"):
            value = getattr(self, name)
            if not 0.0 <= value <= _LONGEST:
                option = name.replace("_", "-")
                raise StillwakeError(f"--{option} = {value}: must be a number of t_c in 0..{_LONGEST:g}")
        if not self.averages:
            return
        least = CYCLES * SHEDDING_TIME
        remedy = f"must be at least {least:g} t_c, {CYCLES} shedding cycles, for averages; without them: --no-averages"
        if self.lead_in < least:
            raise StillwakeError(f"--lead-in = {self.lead_in:g}: {remedy}")
        if round(left := self.controlled - self.settle, 9) < least:
            spans = f"--controlled = {self.controlled:g} less --settle = {self.settle:g}"
            raise StillwakeError(f"{spans} leaves {left:g} t_c: {remedy}")

    def periods(self, control_period: float) -> tuple[int, int]:
        """Return the numbers of periods without control and of all periods. Raises StillwakeError if one is zero."""
        lead_in, controlled = (round(span / control_period) for span in (self.lead_in, self.controlled))
        for name, count in (("lead-in", lead_in), ("controlled", controlled)):
            if count < 1:
                span = f"--{name} = {getattr(self, name.replace('-', '_')):g}"
                raise StillwakeError(f"{span}: shorter than a control period of {control_period:g}")
        return lead_in, lead_in + controlled
