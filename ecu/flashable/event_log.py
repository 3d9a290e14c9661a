"""The events of flashing that are written to the log."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from can_bridge.flashing.access_level import Level
from can_bridge.flashing.boot import Boot, BootReason
from can_bridge.flashing.state import TRIAL_BOOTS
from can_bridge.uds.services import Session

Log = Callable[..., None]
"""The function that logs an event, called with the event's name, its text line, and its fields."""


class TesterAccess(NamedTuple):
    """The session of a tester, the security level that it has unlocked, and its wrong keys.

    Attributes:
        attempts: number of wrong keys in a row, for each security level.
    """

    session: Session
    unlocked: Level | None
    attempts: Mapping[Level, int]


def no_log(event: str, line: str, **fields: str | int | float) -> None:
    """Log nothing."""


def log_boot(log: Log, boot: Boot) -> None:
    """Log the booted release, and the verdicts on the slots."""
    verdicts = {f"slot_{slot.name.lower()}": verdict.in_words for slot, verdict in boot.verdicts.items()}
    if boot.bundle is None or boot.slot is None:
        log("no_release", "every release is damaged or missing: jets shut, waiting to be flashed", **verdicts)
        return
    name, digest = boot.bundle.name, boot.bundle.digest
    event, words = "booted", boot.reason.in_words
    if boot.reason is BootReason.TRIAL:
        event, words = "trial", f"on trial, boot {TRIAL_BOOTS - boot.boots_left} of {TRIAL_BOOTS} without confirmation"
    elif boot.reason is BootReason.REVERTED:
        event = "reverted"
    log(
        event,
        f"booted slot {boot.slot.name}: {name} {digest[:12]}, {words}",
        slot=boot.slot.name,
        release=name,
        digest=digest,
        boots_left=boot.boots_left,
        **verdicts,
    )


def log_access(log: Log, before: TesterAccess, after: TesterAccess) -> None:
    """Log the start or the end of a session, the unlocking of a security level, or the refusal of a key."""
    if after.session is not before.session:
        log("session", f"{after.session.name.lower()} session", session=after.session.name)
    if after.unlocked is not None and after.unlocked is not before.unlocked:
        log("unlocked", f"a tester unlocked {after.unlocked.name.lower()}", level=after.unlocked.name)
    for level, count in after.attempts.items():
        if count > before.attempts[level]:
            words = f"a tester's key for {level.name.lower()} was refused, {count} in a row"
            log("key_refused", words, level=level.name, count=count)
