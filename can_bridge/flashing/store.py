"""Two slots for releases, of which one runs and the other can be written: every rule of the ECU's, once.

Nothing here has a clock, randomness or a thread. A loss of power may end any call: what it had kept until then is a
state from which the next boot finds a valid image, if there was one.

    announce, append .., finish     an image into the slot that is not protected; checked as it lies in the memory
    activate                        booted from the next reset on, `TRIAL_BOOTS` times at most
    confirm                         it stays, and the least security version rises to its own
    revert                          back to the release before

The slot of the confirmed image that boots, or that runs, is never written.
"""

import hashlib
from dataclasses import replace
from typing import Final

from can_bridge.flashing import calibrations, state
from can_bridge.flashing.backing import Backing, Kind, Slot, Work
from can_bridge.flashing.boot import Boot, BootReason
from can_bridge.flashing.checking import Fits, Rules, check
from can_bridge.flashing.medium import MediumError
from can_bridge.flashing.state import MOST_ATTEMPTS, TRIAL_BOOTS, Phase, SlotState, StoreState
from can_bridge.flashing.verdicts import Verdict
from can_bridge.uds.services import Level
from contract.errors import BusError, ConfigError, KeyFileError
from contract.release import key_list
from contract.release.bundle import Bundle
from contract.release.key_list import KeyList
from contract.release.signing import PublicKey

_PIECE: Final = 4096
"""Bytes read at once."""
_SHA256_BYTES: Final = 32


class OutOfOrderError(BusError):
    """What was asked of the store does not fit what stands in it now."""


class Store:
    """The store over its backing, from one power-on to the next.

    Args:
        backing: where everything lies.
        root: the key that signs key lists.
        hardware: name of this ECU's.
        fits: whether a bundle was made for this vehicle.
    """

    def __init__(self, backing: Backing, *, root: PublicKey, hardware: str, fits: Fits) -> None:
        self._backing = backing
        self._root = root
        self._hardware = hardware
        self._fits = fits
        self._state, self._keys = self._remembered()
        self._last_boot: Boot | None = None
        self._running: Slot | None = None
        self._filling: Slot | None = None
        """Whose memory stands exactly behind what was received."""

    @classmethod
    def provision(
        cls,
        backing: Backing,
        *,
        root: PublicKey,
        keys: bytes,
        image: bytes | None,
        hardware: str,
        fits: Fits,
    ) -> "Store":
        """Fill an empty backing, at production: a key list, and an image as the confirmed one of slot A.

        Raises:
            OutOfOrderError: the backing is not empty.
            KeyFileError: the root key did not sign the list.
            ConfigError: the image fails a check.
            MediumError: the memory is bad.
        """
        if backing.records():
            raise OutOfOrderError("the store is provisioned already: it must be empty")
        store = cls(backing, root=root, hardware=hardware, fits=fits)
        store.take_keys(keys)
        if image is not None:
            _run(store.announce(len(image), hashlib.sha256(image).digest()))
            for at in range(0, len(image), _PIECE):
                store.append(image[at : at + _PIECE])
            if (verdict := _run(store.finish())) != Verdict.GOOD:
                raise ConfigError(f"image: {verdict.in_words}; must be a bundle for this ECU")
            store._confirm(Slot.A)
        else:
            store._keep(store.state)
        return store

    @property
    def state(self) -> StoreState:
        """As it is kept."""
        return self._state

    @property
    def keys(self) -> KeyList | None:
        """Which keys may sign; None without a list that is in order."""
        return self._keys

    @property
    def capacity(self) -> int:
        """Bytes of the greatest image."""
        return self._backing.capacity

    @property
    def last_boot(self) -> Boot | None:
        """What `boot` found; None before."""
        return self._last_boot

    @property
    def running(self) -> Slot | None:
        """The slot that was booted, as long as the image is still in it."""
        return self._running

    @property
    def received(self) -> int | None:
        """Bytes there are of the announced image, and so the offset of the next ones; None if none is announced."""
        return None if self._filling is None else self._state.slots[self._filling].received

    # Boot.

    def boot(self) -> Boot:
        """Choose an image and check all of it. A boot on trial is counted before it; never raises for what it finds."""
        verdicts: dict[Slot, Verdict] = {}
        boot = self._boot_trial(verdicts)
        reason = BootReason.CONFIRMED if self._state.on_trial is None and boot is None else BootReason.TRIAL
        raise NotImplementedError(reason)

    # Transfer.

    def announce(self, length: int, sha256: bytes) -> Work[int]:
        """Make room for an image.

        Returns:
            The offset from which its bytes are wanted: more than 0 if an interrupted transfer of this very image stands
            there, `length` if all of it does.

        Raises:
            ConfigError: the length or the hash is out of range.
            MediumError: the memory is bad.
        """
        raise NotImplementedError

    def append(self, data: bytes) -> None:
        """The next bytes of the announced image; they outlive a loss of power once this returns.

        Raises:
            OutOfOrderError: no image is announced, or these are more bytes than were.
            MediumError: the memory is bad; announce the image again.
        """
        raise NotImplementedError

    def finish(self) -> Work[Verdict]:
        """Check the announced image as it lies in the memory; GOOD makes it `Phase.CHECKED`, INCOMPLETE leaves it.

        Raises:
            OutOfOrderError: no image is announced.
            MediumError: the verdict cannot be kept.
        """
        raise NotImplementedError

    def drop(self) -> None:
        """The session ended; the transfer goes on with the next announcement of the same image."""
        self._filling = None

    # Choice.

    def activate(self) -> None:
        """Boot the checked image from the next reset on, on trial; raises OutOfOrderError if there is none."""
        raise NotImplementedError

    def confirm(self) -> None:
        """Keep the release that runs on trial; nothing changes if it is confirmed already.

        Raises:
            OutOfOrderError: no release runs, or it was written over.
            MediumError: it cannot be kept.
        """
        raise NotImplementedError

    def revert(self) -> Work[Verdict]:
        """Go back, from the next reset on: from a trial to the confirmed release, or to the one before that.

        Returns:
            GOOD, or why the release before may not run any more; nothing has changed then.

        Raises:
            OutOfOrderError: there is no release before.
            MediumError: it cannot be kept.
        """
        raise NotImplementedError

    # Keys, calibration, attempts.

    def take_keys(self, raw: bytes) -> None:
        """Replace the key list.

        Raises:
            KeyFileError: not signed by the root key, not newer, or without the key of the confirmed release, which
                could not boot any more.
            MediumError: it cannot be kept.
        """
        raise NotImplementedError

    def calibration(self, digest: str) -> bytes | None:
        """What was kept for the release with this digest."""
        raise NotImplementedError

    def keep_calibration(self, blob: bytes | None) -> None:
        """Keep a calibration for the release that runs, or none.

        Raises:
            OutOfOrderError: no release runs.
            MediumError: it cannot be kept.
        """
        raise NotImplementedError

    def failed_attempts(self, level: Level) -> int:
        """Wrong keys in a row, up to 255."""
        return self._state.failed_attempts[level]

    def keep_failed_attempts(self, level: Level, count: int) -> None:
        """Keep them; raises MediumError if they cannot be kept."""
        raise NotImplementedError
