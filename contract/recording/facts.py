"""What a recording's plant is known to be: clock, limit of the jets, Reynolds number."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from math import isfinite
from typing import Any, Final, Literal

from contract.errors import DatasetError

ForcesClock = Literal["log", "start", "t_c"]
"""What times of forces next to a log count: s on its clock, s since its first pressure, or W / U_inf since then."""


@dataclass(frozen=True, kw_only=True)
class PlantFacts:
    """Facts that training must agree with; None where one is not known.

    Attributes:
        control_period: time between two samples, in t_c = W / U_inf.
        action_limit: bound on the action's magnitude, in U_inf W.
        reynolds: U_inf W / nu.

    Raises DatasetError for a number that is not positive and finite.
    """

    control_period: float | None = None
    action_limit: float | None = None
    reynolds: float | None = None

    def __post_init__(self) -> None:
        for name, value in self.as_dict().items():
            if value is not None and not (isfinite(value) and value > 0):
                raise DatasetError(f"{name} = {value}: must be positive and finite")

    def as_dict(self) -> dict[str, float | None]:
        """By name, in order; the names are those of the settings `flow.*`."""
        return {name: getattr(self, name) for name in FACTS}


FACTS: Final = tuple(item.name for item in fields(PlantFacts))
"""Names of the facts."""


def facts_in(provenance: Mapping[str, Any]) -> PlantFacts:
    """The facts that an episode's own provenance has under "flow"; unknown where it has none."""
    flow = provenance.get("flow")
    found = flow if isinstance(flow, Mapping) else {}
    return PlantFacts(**{name: _number(found.get(name)) for name in FACTS})


def first_known(facts: Iterable[PlantFacts]) -> PlantFacts:
    """Every fact as the first that knows it has it."""
    known: dict[str, float | None] = dict.fromkeys(FACTS)
    for one in facts:
        known = {name: value if known[name] is None else known[name] for name, value in one.as_dict().items()}
    return PlantFacts(**known)


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
