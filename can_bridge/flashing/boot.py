"""The choice of the image to boot, and the reason for the choice."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from can_bridge.flashing.backing import MediumError, Slot, at_once
from can_bridge.flashing.checking import Release
from can_bridge.flashing.remembered import Remembered
from can_bridge.flashing.state import SlotPhase
from can_bridge.flashing.verdicts import InWords, Verdict


class BootReason(InWords):
    CONFIRMED = 1, "confirmed"
    TRIAL = 2, "on trial"
    """An activated image that has not been confirmed yet."""
    REVERTED = 3, "confirmed; the release on trial was rejected"
    """The image on trial failed a check or was not confirmed in time."""
    FALLBACK = 4, "the previous release; the confirmed release is damaged"
    NO_RELEASE = 5, "every release is damaged or missing"
    """No image passed its checks: the jets stay shut, and a release can be flashed."""


@dataclass(frozen=True, kw_only=True)
class Boot:
    """The result of a boot. `slot` and `bundle` are None if no release booted. `verdicts` has a verdict for each slot
    that was checked. `boots_left` is the number of boots left in a trial; 0 if the release is not on trial."""

    slot: Slot | None = None
    bundle: Release | None = None
    verdicts: Mapping[Slot, Verdict]
    reason: BootReason
    boots_left: int = 0


def boot(remembered: Remembered) -> Boot:
    """See `Store.boot`."""
    trial = remembered.state.on_trial
    verdicts: dict[Slot, Verdict] = {}
    on_trial = None if trial is None else _boot_trial(remembered, trial, verdicts)
    return on_trial or _boot_confirmed(remembered, trial is not None, verdicts)


def _boot_trial(remembered: Remembered, slot: Slot, verdicts: dict[Slot, Verdict]) -> Boot | None:
    """Return the boot of the image on trial, if it has a boot left and passes its checks; otherwise reject it."""
    standing = remembered.state.slots[slot]
    try:
        if standing.boots_left > 0:
            # The boot is counted before the image runs, so that it is also counted if the image crashes.
            left = standing.boots_left - 1
            remembered.keep_slot(slot, replace(standing, boots_left=left))
            verdicts[slot], bundle = at_once(remembered.judged(slot))
            if bundle is not None:
                return Boot(slot=slot, bundle=bundle, verdicts=verdicts, reason=BootReason.TRIAL, boots_left=left)
        remembered.keep_slot(slot, replace(standing, phase=SlotPhase.BAD, boots_left=0))
    except MediumError:
        # If the boot cannot be counted, the image is not run, because the trial would never end.
        verdicts.setdefault(slot, Verdict.UNREADABLE)
    return None


def _boot_confirmed(remembered: Remembered, is_reverted: bool, verdicts: dict[Slot, Verdict]) -> Boot:
    """Return the boot of the confirmed image, or of the image confirmed before it. An image that fails a check stays
    confirmed, so that a wrong stillwake.dbc or wrong vehicle data in the ECU can be corrected."""
    active = remembered.state.active
    for slot in () if active is None else (active, active.other):
        if remembered.state.slots[slot].phase != SlotPhase.CONFIRMED:
            continue
        verdicts[slot], bundle = at_once(remembered.judged(slot))
        if bundle is not None:
            expected = BootReason.REVERTED if is_reverted else BootReason.CONFIRMED
            reason = expected if slot == active else BootReason.FALLBACK
            return Boot(slot=slot, bundle=bundle, verdicts=verdicts, reason=reason)
    return Boot(verdicts=verdicts, reason=BootReason.NO_RELEASE)
