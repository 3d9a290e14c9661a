"""Which image is booted, and why."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto

from can_bridge.flashing.backing import Slot
from can_bridge.flashing.verdicts import Verdict
from contract.release.bundle import Bundle


class BootReason(Enum):
    """Why this image was booted."""

    CONFIRMED = auto()
    TRIAL = auto()
    """An activated image, which waits for its confirmation."""
    REVERTED = auto()
    """The confirmed image, because the one on trial failed a check or was not confirmed in time."""
    FALLBACK = auto()
    """The release before the confirmed one, because that failed a check."""
    NO_RELEASE = auto()
    """No image is in order: the jets stay shut, and a release can be flashed."""

    @property
    def in_words(self) -> str:
        return _WORDS[self]


_WORDS = {
    BootReason.CONFIRMED: "confirmed",
    BootReason.TRIAL: "on trial",
    BootReason.REVERTED: "confirmed; the release on trial was given up",
    BootReason.FALLBACK: "the one before; the confirmed release is not in order",
    BootReason.NO_RELEASE: "no release is in order",
}


@dataclass(frozen=True, kw_only=True)
class Boot:
    """What a boot came to.

    Attributes:
        slot: that was booted; None without a release.
        bundle: of it, every check made in this boot; None without a release.
        verdicts: on the slots that this boot looked at.
        boots_left: of the trial, this one not counted; 0 where the release is not on trial.
    """

    slot: Slot | None
    bundle: Bundle | None
    verdicts: Mapping[Slot, Verdict]
    reason: BootReason
    boots_left: int = 0
