"""The definition of an episode, an uninterrupted recording: its series, their units, and the conditions for validity.

Sample k holds Cp and the forces at t_k, and the action a_k commanded at t_k. The action of the jets changes linearly
from a_{k-1} to a_k over [t_k, t_{k+1}]. Cd and Cl are pressure and viscous force on the wall without the slot faces.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import isfinite
from typing import Any, Final, Literal, get_args

import numpy as np

from contract.arrays import Array, Index
from contract.errors import DatasetError
from contract.ledger import LEDGER_FIELDS, DragLedger, ledger_of

Role = Literal["train", "test", "extended", "controlled", "calm"]
"""Use of an episode. The model is fitted to "train" episodes and tested on "test" episodes. "extended" episodes have
forcing beyond the training range, "controlled" episodes have a controller, "calm" episodes begin at the steady wake."""
ROLES: Final[tuple[Role, ...]] = get_args(Role)
UNITS: Final[Mapping[str, str]] = {
    "t": "W/U_inf",
    "action": "U_inf W",
    "Cp": "1",
    "Cd": "1",
    "Cl": "1",
    "Cd_slot_pressure": "1",
    "Cd_slot_viscous": "1",
    "Cd_momentum": "1",
    "jet_power": "rho U_inf^3 W / 2",
    "Uy_probe": "U_inf",
}
"""Unit of every series that an episode may have. A series has a row per control step; Cp has a column per sensor."""
REQUIRED: Final = ("t", "action", "Cp", "Cd", "Cl")
"""Series that training and export read. The other series exist only if the plant provides them."""
ForcesClock = Literal["log", "start", "t_c"]
"""Clock of the times in a table of forces for a log. "log" means seconds on the log's clock, "start" means seconds
since the log's first pressure, and "t_c" means units of W / U_inf since this pressure."""


@dataclass(frozen=True, kw_only=True)
class PlantFacts:
    """The facts about a plant. The settings for training must agree with these facts. An unknown fact is None. The
    period is in t_c = W / U_inf, the bound on the action's magnitude in U_inf W; the Reynolds number is U_inf W / nu.
    Raises DatasetError for a number that is not positive and finite."""

    control_period: float | None = None
    action_limit: float | None = None
    reynolds: float | None = None

    def __post_init__(self) -> None:
        for name, value in self.known.items():
            if not (isfinite(value) and value > 0):
                raise DatasetError(f"{name} = {value}: must be positive and finite")

    @property
    def known(self) -> dict[str, float]:
        """The known facts by the names of the settings in `flow`, in order."""
        return {name: value for name, value in vars(self).items() if value is not None}


FACTS: Final = tuple(item.name for item in fields(PlantFacts))
"""Names of the facts about the plant."""


def facts_in(provenance: Mapping[str, Any]) -> PlantFacts:
    """Return the facts that an episode's provenance states under "flow"."""
    flow = provenance.get("flow")
    found = flow if isinstance(flow, Mapping) else {}
    numbers = {name: value for name in FACTS if isinstance(value := found.get(name), int | float)}
    return PlantFacts(**{name: float(value) for name, value in numbers.items() if not isinstance(value, bool)})


@dataclass(frozen=True, kw_only=True, eq=False)
class Episode:
    """An uninterrupted recording of n control steps, with a name that is unique within the data set. `series` has the
    arrays of `REQUIRED` and, if recorded, of the other names in `UNITS`; Cp is (n, sensors), all others (n,).
    `initial_action` is the action a_{-1} of the jets before the first sample. `provenance` has forcing parameters,
    seed, solver settings and software versions. Raises DatasetError with episode and field of an invalid part."""

    name: str
    role: Role
    series: Mapping[str, Array]
    initial_action: float
    provenance: Mapping[str, Any]

    def __post_init__(self) -> None:
        for problem in problems_of(self.name, self.role, self.series, self.initial_action):
            raise DatasetError(problem)

    def __len__(self) -> int:
        return len(self.series["t"])

    @property
    def previous_action(self) -> Array:
        """Actions a_{k-1} of all n samples k, (n,). The encoder reads a_{k-1} together with Cp_k."""
        return np.concatenate([[self.initial_action], self.series["action"][:-1]])

    def rows(self, columns: Index, sign: float = 1.0) -> Array:
        """Return rows (Cp_k, a_{k-1}), (n, S+1). `sign` multiplies the action; it is -1 for a mirror image."""
        return np.column_stack([self.series["Cp"][:, columns], sign * self.previous_action])

    @property
    def ledger(self) -> DragLedger[Array]:
        """The drag ledger; every entry is (n,). Raises DatasetError if a series of the ledger was not recorded."""
        for field in LEDGER_FIELDS:
            if field not in self.series:
                raise DatasetError(f"episode {self.name}: the drag ledger needs the series {field!r}, which is missing")
        return ledger_of(self.series)


def problems_of(name: str, role: object, series: Mapping[str, Array], initial_action: float) -> list[str]:
    """Return the problems of an episode with these parts, as one line per problem."""
    found: list[str] = []

    def refuse(field: str, reason: str) -> None:
        found.append(f"episode {name}: field {field!r} {reason}")

    if not name.isprintable() or not name or "/" in name:
        refuse("name", "must be printable text, not empty and without a slash")
    if role not in ROLES:
        refuse("role", f"is {role!r}, must be one of {ROLES}")
    for field in REQUIRED:
        if field not in series:
            refuse(field, "is missing")
    steps = len(series["t"]) if "t" in series and series["t"].ndim else None
    if steps == 0:
        refuse("t", "holds no control step")
    for field, array in series.items():
        if field not in UNITS:
            continue
        length = steps if steps is not None else "n"
        expected = f"({length}, sensors)" if field == "Cp" else f"({length},)"
        if array.ndim != (2 if field == "Cp" else 1) or (steps is not None and len(array) != steps):
            refuse(field, f"has shape {array.shape}, must be {expected}")
        elif not np.isfinite(array).all():
            first = int(np.argwhere(~np.isfinite(array))[0][0])
            refuse(field, f"holds a value that is not finite, first at step {first}")
    if not np.isfinite(initial_action):
        refuse("initial_action", "is not finite")
    return found
