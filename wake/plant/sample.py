"""The measurements of a plant at one instant. This module imports no plant, because importing a plant takes long."""

from dataclasses import dataclass

from contract.arrays import Array
from contract.ledger import DragLedger


@dataclass(frozen=True, kw_only=True, eq=False)
class Sample(DragLedger[float]):
    """The measurements of a plant at one instant, t in t_c: the drag ledger, the pressure coefficients at the n sensors
    (n,) relative to the pressure at the outlet, the transverse velocity at the wake probe
    (`contract.config.body.BodyConfig.wake_probe`), and the jet flow rate in force."""

    t: float
    Cp: Array
    Uy_probe: float
    action: float
