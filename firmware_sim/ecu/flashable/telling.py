"""What happens in flashing and is worth a line in the log."""

from collections.abc import Callable
from typing import Final

from can_bridge.flashing.boot import Boot, BootReason
from can_bridge.flashing.state import TRIAL_BOOTS
from can_bridge.uds.services import Level, Session

Tell = Callable[..., None]
Access = tuple[Session, Level | None]

_WORDS: Final = {Level.PROGRAMMING: "programming", Level.CALIBRATION: "calibration"}


def tell_boot(tell: Tell, boot: Boot) -> None:
    """What was booted, and why."""
    verdicts = {f"slot_{slot.name.lower()}": verdict.in_words for slot, verdict in boot.verdicts.items()}
    if boot.bundle is None or boot.slot is None:
        tell("no_release", "no release is in order: jets shut, waiting to be flashed", **verdicts)
        return
    name, digest = boot.bundle.manifest.name, boot.bundle.digest
    event, words = "booted", boot.reason.in_words
    if boot.reason is BootReason.TRIAL:
        trial = TRIAL_BOOTS - boot.boots_left
        event, words = "trial", f"on trial, boot {trial} of {TRIAL_BOOTS} without confirmation"
        verdicts["trial"] = str(trial)
    elif boot.reason is BootReason.REVERTED:
        event = "reverted"
    tell(
        event,
        f"booted slot {boot.slot.name}: {name} {digest[:12]}, {words}",
        slot=boot.slot.name,
        bundle=name,
        digest=digest,
        **verdicts,
    )


def tell_access(tell: Tell, before: Access, after: Access) -> None:
    """A session that began or ended, and a level that was unlocked."""
    if after[0] is not before[0]:
        tell("session", f"{after[0].name.lower()} session", session=after[0].name)
    if after[1] is not None and after[1] is not before[1]:
        tell("unlocked", f"{_WORDS[after[1]]} unlocked by a tester", level=after[1].name)


def tell_attempt(tell: Tell, level: Level, count: int) -> None:
    """A key is being looked at; the count begins at 0 again when it is right."""
    tell("key_counted", f"key for {_WORDS[level]}, attempt {count} in a row", level=level.name, count=count)
