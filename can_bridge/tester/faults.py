"""The ECU's fault memory as a tester reads and clears it, over an open client."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from can_bridge.tester.asking import Asking
from can_bridge.tester.messages import NotNowError, RefusedError
from can_bridge.uds.fault_codes import REASON_BY_CODE, Snapshot
from can_bridge.uds.fault_memory import Status
from can_bridge.uds.services import Nrc
from can_bridge.wire.messages import Mode, Reason
from contract.errors import FlashError

_ENTERED = Status.PENDING | Status.CONFIRMED | Status.TEST_FAILED


@dataclass(frozen=True, kw_only=True)
class StoredFault:
    """One code that is or was present.

    Attributes:
        code: three bytes.
        age: operation cycles without it since it was found last.
        time_ms, mode_before, missed, overruns, pressures_cp: of the moment in which it was found; None without.
    """

    code: int
    reason: Reason
    status: Status
    age: int
    time_ms: int | None = None
    mode_before: Mode | None = None
    missed: int | None = None
    overruns: int | None = None
    pressures_cp: tuple[float, ...] | None = None


def read(asking: Asking) -> list[StoredFault]:
    """All codes that are pending, confirmed or present; raises FlashError for codes of another version."""
    found = asking.faults("get_dtc_by_status_mask", int(_ENTERED))
    return [_read_one(asking, int(dtc.id), int(dtc.status.get_byte_as_int())) for dtc in found]


def clear(asking: Asking) -> None:
    """Forget all of them; raises NotNowError while a jet may run."""
    try:
        asking.clear_faults()
    except RefusedError as refused:
        if refused.code != Nrc.CONDITIONS_NOT_CORRECT:
            raise
        raise NotNowError(
            "the ECU refused to clear its faults now: its jets are enabled; withdraw the enable request and try again"
        ) from refused


def _read_one(asking: Asking, code: int, status: int) -> StoredFault:
    try:
        reason = REASON_BY_CODE[code]
        snapshots = asking.faults("get_dtc_snapshot_by_dtc_number", code)[0].snapshots
        extended = asking.faults("get_dtc_extended_data_by_dtc_number", code, data_size=1)[0].extended_data
        kept: dict[int, Any] = {int(one.did): one.data for one in snapshots}
        moment = {each.name.lower(): kept[each][0] for each in Snapshot if kept and each is not Snapshot.PRESSURES_CP}
        if kept:
            moment |= {"mode_before": Mode(kept[Snapshot.MODE_BEFORE][0]), "pressures_cp": kept[Snapshot.PRESSURES_CP]}
        age = extended[0].raw_data[0] if extended else 0
        return StoredFault(code=code, reason=reason, status=Status(status), age=age, **moment)
    except (KeyError, IndexError, ValueError) as error:
        raise FlashError(f"the ECU has fault {code:06X} of another version of stillwake ({error})") from error
