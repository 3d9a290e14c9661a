"""The drag ledger: every force along the road that the jets change, and the power they take.

A drag reduction counts only together with its price. The wall's drag is what the controller reduces; the slot faces,
the reaction to the jets' momentum and the jets' power are reported next to it, and `Cd_net` sums the forces.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Final, Generic, TypeVar

from contract.arrays import Array

Value = TypeVar("Value", float, Array)
"""One instant, or a time series of shape (n,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DragLedger(Generic[Value]):
    """Forces per unit of rho U_inf^2 W / 2, at one instant or as time series.

    Attributes:
        Cd, Cl: wall force without the slot faces.
        Cd_slot_pressure, Cd_slot_viscous: pressure and viscous force on the slot faces.
        Cd_momentum: reaction to the momentum the jets carry, negative for thrust.
        jet_power: power the jets hand to the flow, per unit of rho U_inf^3 W / 2.
    """

    Cd: Value
    Cl: Value
    Cd_slot_pressure: Value
    Cd_slot_viscous: Value
    Cd_momentum: Value
    jet_power: Value

    @property
    def Cd_slot(self) -> Value:
        """Force on the slot faces."""
        return self.Cd_slot_pressure + self.Cd_slot_viscous

    @property
    def Cd_net(self) -> Value:
        """Wall, slot and momentum together: what the vehicle's axle would feel."""
        return self.Cd + self.Cd_slot + self.Cd_momentum


LEDGER_FIELDS: Final = tuple(item.name for item in fields(DragLedger))
"""Names of the entries, in order; the derived ones are not among them."""


def ledger_of(series: Mapping[str, Value]) -> DragLedger[Value]:
    """The ledger among named series; others are left out. Raises KeyError naming an entry that is missing."""
    return DragLedger(**{name: series[name] for name in LEDGER_FIELDS})
