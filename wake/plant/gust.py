"""Wind against the body that varies in time, the same everywhere far from it.

It is the wind of a body whose speed through the air varies, in the body's own frame (`wake.solver.navier_stokes`), so
that pressures stay relative to the free stream. Forces and pressures keep the unit of the mean U_inf.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, pi, sin

Wind = Callable[[float], float]
"""Time in t_c to how much the wind exceeds U_inf, in U_inf."""


@dataclass(frozen=True, kw_only=True)
class Gust:
    """A sine about U_inf.

    Attributes:
        amplitude: in U_inf.
        period, start: in t_c.
        cycles: how many periods it lasts; a whole number, so that it ends at U_inf as it begins.
    """

    amplitude: float
    period: float
    start: float = 0.0
    cycles: float = inf

    def __call__(self, t: float) -> float:
        """See `Wind`."""
        phase = (t - self.start) / self.period
        return self.amplitude * sin(2.0 * pi * phase) if 0.0 <= phase <= self.cycles else 0.0
