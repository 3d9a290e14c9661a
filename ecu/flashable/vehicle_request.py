"""Whether the vehicle asks for control, or has it: then nothing is flashed."""

from dataclasses import dataclass, replace
from typing import Final, Self

from can_bridge.uds.services import Nrc
from ecu.ecu_state import EcuState

REMEMBERED_NS: Final = 1_000_000_000
"""For which a request counts after the frame that carried it: what a lost bus or a lying sensor leaves open."""


@dataclass(frozen=True, kw_only=True)
class VehicleRequest:
    """As seen in the control steps.

    Attributes:
        asked_ns: of the latest step with usable pressures that asked for control; None before the first.
        drives_jets: whether the jets could run after the latest step.
    """

    asked_ns: int | None = None
    drives_jets: bool = False

    def seen(self, before: EcuState, after: EcuState, now_ns: int) -> Self:
        """After one more control step."""
        usable = after.missed == before.missed
        asks = usable and after.fail_safe.enable_request
        return replace(self, asked_ns=now_ns if asks else self.asked_ns, drives_jets=after.fail_safe.mode.drives_jets)

    def refusal(self, now_ns: int) -> Nrc | None:
        """CONDITIONS_NOT_CORRECT while the jets may run, or the vehicle asked for control in the last second."""
        asks = self.asked_ns is not None and now_ns - self.asked_ns < REMEMBERED_NS
        return Nrc.CONDITIONS_NOT_CORRECT if self.drives_jets or asks else None
