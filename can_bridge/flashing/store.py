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

from can_bridge.flashing.backing import Backing, Long, MediumError, RecordKind, Slot, at_once
from can_bridge.flashing.boot import Boot, boot
from can_bridge.flashing.checking import Fits, ImageCheck, check
from can_bridge.flashing.remembered import PIECE, Remembered
from can_bridge.flashing.state import TRIAL_BOOTS, SlotPhase, SlotState, StoreState
from can_bridge.flashing.verdicts import Verdict
from contract.errors import BusError, ConfigError
from contract.release.key_list import KeyList
from contract.release.signing import PublicKey

_SHA256_BYTES: Final = 32


class OutOfOrderError(BusError):
    """What was asked of the store does not fit what stands in it now."""


class Store:
    """The store over its backing, from one power-on to the next.

    Args:
        backing: where everything lies.
        root: the key that signs key lists.
        hardware: name of this ECU's.
        fits: whether a release was made for this vehicle.
        check: of an image: that of bundles, or `judge_image` for the images of microcontrollers.
    """

    def __init__(
        self, backing: Backing, *, root: PublicKey, hardware: str, fits: Fits, check: ImageCheck = check
    ) -> None:
        self._remembered = Remembered(backing, root=root, hardware=hardware, fits=fits, check=check)
        self._last_boot: Boot | None = None
        self._running: Slot | None = None
        self._announced: Slot | None = None
        """The slot of the transfer under way: the memory stands exactly behind what was received."""

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
        check: ImageCheck = check,
    ) -> "Store":
        """Fill an empty backing, at production: a key list, and an image as the confirmed one of slot A.

        Raises:
            OutOfOrderError: the backing is not empty.
            KeyFileError: the root key did not sign the list.
            ConfigError: the image fails a check.
            MediumError: the memory is bad.
        """
        store = cls(backing, root=root, hardware=hardware, fits=fits, check=check)
        if store.state.active is not None:
            raise OutOfOrderError("the store has a confirmed release: it must be empty to be provisioned")
        if backing.records().get(RecordKind.KEYS) != keys:
            store.take_keys(keys)
        if image is not None:
            at_once(store.announce(len(image), hashlib.sha256(image).digest()))
            for at in range(store.received or 0, len(image), PIECE):
                store.append(image[at : at + PIECE])
            if (verdict := at_once(store.finish())) != Verdict.GOOD:
                raise ConfigError(f"image: {verdict.in_words}; must be a bundle for this ECU")
            store._confirm(Slot.A)
        return store

    @property
    def state(self) -> StoreState:
        """The state that is kept."""
        return self._remembered.state

    @property
    def records(self) -> Remembered:
        """Where calibrations and failed attempts are kept."""
        return self._remembered

    @property
    def keys(self) -> KeyList | None:
        """Which keys may sign; None without a list that is in order."""
        return self._remembered.keys

    @property
    def capacity(self) -> int:
        """Bytes of the greatest image."""
        return self._remembered.backing.capacity

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
        return None if self._announced is None else self.state.slots[self._announced].received

    def boot(self) -> Boot:
        """Choose an image and check all of it. A boot on trial is counted before it; never raises for what it finds."""
        self._announced = None
        self._last_boot = boot(self._remembered)
        self._running = self._last_boot.slot
        return self._last_boot

    # Transfer.

    def announce(self, length: int, sha256: bytes) -> Long[int]:
        """Make room for an image. Returns the offset from which its bytes are wanted: more than 0 if an interrupted
        transfer of this very image stands there, `length` if all of it does; less than was received where the memory
        can go on only from there.

        Raises:
            ConfigError: the length or the hash is out of range.
            OutOfOrderError: `revert` made another release the confirmed one, and the ECU was not reset since.
            MediumError: the memory is bad.
        """
        if not 0 < length <= self.capacity:
            raise ConfigError(f"image of {length} bytes: must have 1 to {self.capacity} for this ECU")
        if len(sha256) != _SHA256_BYTES:
            raise ConfigError(f"image: a SHA-256 of {len(sha256)} bytes: must have {_SHA256_BYTES}")
        slot = self._writable_slot()
        standing = self.state.slots[slot]
        self._announced = None
        if self._running == slot:
            self._running = None
        is_here = standing.holds(length, sha256) and not self._is_known_bad(slot)
        stays = self._stays(slot) if is_here else None
        wanted = stays or 0
        announced = SlotState(phase=SlotPhase.FILLING, length=length, sha256=sha256, received=wanted)
        if stays is None or stays < standing.received:
            # Until it is announced, what a cut leaves behind these bytes does not count.
            self._remembered.keep(self._without(slot).with_slot(slot, announced if stays else SlotState()))
            yield from self._remembered.backing.clear(slot, wanted)
        if announced != self.state.slots[slot]:
            self._remembered.keep(self._without(slot).with_slot(slot, announced))
        self._announced = slot
        return wanted

    def append(self, data: bytes) -> None:
        """The next bytes of the announced image; they outlive a loss of power once this returns. Raises OutOfOrderError
        if no image is announced, or these are more bytes than were; MediumError if the memory is bad: announce the
        image again."""
        slot, standing = self._transfer()
        if standing.phase != SlotPhase.FILLING or standing.received + len(data) > standing.length:
            raise OutOfOrderError(
                f"image: {len(data)} bytes behind {standing.received}: must end at the announced {standing.length}"
            )
        self._announced = None
        self._remembered.backing.append(slot, data)
        self._remembered.keep_slot(slot, replace(standing, received=standing.received + len(data)))
        self._announced = slot

    def finish(self) -> Long[Verdict]:
        """Check the announced image as it lies in the memory; GOOD makes it `SlotPhase.CHECKED`, INCOMPLETE leaves it.

        May be repeated until the image is activated. Raises OutOfOrderError if no image is announced; MediumError if
        the verdict cannot be kept.
        """
        slot, standing = self._transfer()
        if standing.received < standing.length:
            return Verdict.INCOMPLETE
        verdict, bundle = yield from self._remembered.judged(slot)
        checked = SlotState(
            phase=SlotPhase.BAD, length=standing.length, sha256=standing.sha256, received=standing.received
        )
        if bundle is not None:
            checked = replace(
                checked,
                phase=SlotPhase.CHECKED,
                digest=bundle.digest,
                name=bundle.name,
                security_version=bundle.security_version,
                signer=b"" if bundle.signer is None else bundle.signer.raw,
            )
        if checked != standing:
            self._remembered.keep_slot(slot, checked)
        return verdict

    def drop(self) -> None:
        """The session ended; the transfer goes on with the next announcement of the same image."""
        self._announced = None

    # Choice.

    def activate(self) -> None:
        """Boot the checked image from the next reset on, on trial; nothing changes if that is so already. Raises
        OutOfOrderError if no image is checked; MediumError if it cannot be kept."""
        state, slot, trial = self.state, self.state.checked, self.state.on_trial
        if slot is None:
            if trial is not None and trial != self._running:
                return
            raise OutOfOrderError("no image to activate: one must be transferred and checked first")
        if trial is not None:
            state = state.with_slot(trial, _given_up(state.slots[trial]))
        self._remembered.keep(
            state.with_slot(slot, replace(state.slots[slot], phase=SlotPhase.TRIAL, boots_left=TRIAL_BOOTS))
        )
        self._announced = None

    def confirm(self) -> None:
        """Keep the release that runs on trial; nothing changes if it is confirmed already. Raises OutOfOrderError if no
        release runs, or it is neither on trial nor confirmed any more, or its key may no longer sign; MediumError if it
        cannot be kept."""
        slot = self._running
        phase = None if slot is None else self.state.slots[slot].phase
        if slot is None or phase not in (SlotPhase.TRIAL, SlotPhase.CONFIRMED):
            raise OutOfOrderError("no release to confirm: an activated one must run")
        if phase == SlotPhase.TRIAL:
            if self.keys is None or PublicKey(self.state.slots[slot].signer) not in self.keys.keys:
                # It would not boot again, and the one before may be too old from now on.
                raise OutOfOrderError("the release on trial is signed by a key that was taken off the list: revert it")
            self._confirm(slot)

    def _confirm(self, slot: Slot) -> None:
        standing = self.state.slots[slot]
        self._remembered.keep(
            self.state.with_slot(
                slot,
                replace(standing, phase=SlotPhase.CONFIRMED, boots_left=0),
                active=slot,
                least_security_version=max(self.state.least_security_version, standing.security_version),
            )
        )

    def revert(self) -> Long[Verdict]:
        """Go back, from the next reset on: from a trial to the confirmed release, or to the one before that. Returns
        GOOD, or why the release before may not run any more; nothing has changed then. Raises OutOfOrderError if there
        is no release before; MediumError if it cannot be kept."""
        trial, active = self.state.on_trial, self.state.active
        if trial is not None:
            self._remembered.keep_slot(trial, _given_up(self.state.slots[trial]))
            return Verdict.GOOD
        # By what runs: if the answer is lost, and the request comes again, it must not lead back to where it was.
        now = self._running if self._running is not None else active
        if now is None or self.state.slots[now.other].phase != SlotPhase.CONFIRMED:
            raise OutOfOrderError("no release to go back to: none is on trial, and none was confirmed before")
        verdict, _ = yield from self._remembered.judged(now.other)
        if verdict == Verdict.GOOD and active != now.other:
            self._remembered.keep(replace(self.state, active=now.other))
        return verdict

    # Keys and calibration.

    def take_keys(self, raw: bytes) -> None:
        """Replace the key list. Raises KeyFileError if not signed by the root key, not newer, or without the key of a
        confirmed release that could not boot any more: the active one, or the one that runs; MediumError if it cannot
        be kept."""
        needed = {slot for slot in (self.state.active, self._running) if slot is not None}
        self._remembered.take_keys(
            raw, {slot for slot in needed if self.state.slots[slot].phase == SlotPhase.CONFIRMED}
        )

    def keep_calibration(self, blob: bytes | None) -> None:
        """Keep a calibration for the release that runs, or none.

        Raises:
            OutOfOrderError: no release runs.
            ConfigError: it is too long.
            MediumError: it cannot be kept.
        """
        if self._running is None:
            raise OutOfOrderError("no release to keep a calibration for: one must run")
        self._remembered.keep_calibration(self.state.slots[self._running].digest, blob)

    # Slots.

    def _writable_slot(self) -> Slot:
        """The slot that is not protected: by the release that runs, if it is confirmed, or by the confirmed one."""
        running, active = self._running, self.state.active
        if running is None or (active is not None and self.state.slots[running].phase != SlotPhase.CONFIRMED):
            return Slot.A if active is None else active.other
        if active is not None and running != active and not self._is_known_bad(active):
            raise OutOfOrderError("the release before boots from the next reset on: reset the ECU first")
        return running.other

    def _without(self, slot: Slot) -> StoreState:
        """The state with an empty slot; a confirmed release in the other one is active then."""
        is_confirmed = self.state.slots[slot.other].phase == SlotPhase.CONFIRMED
        return self.state.with_slot(slot, SlotState(), active=slot.other if is_confirmed else None)

    def _is_known_bad(self, slot: Slot) -> bool:
        """Whether it was booted and failed, so that its image has to come again."""
        found = {} if self._last_boot is None else self._last_boot.verdicts
        was_booted = self.state.slots[slot].phase in (SlotPhase.TRIAL, SlotPhase.CONFIRMED)
        return was_booted and found.get(slot, Verdict.GOOD) != Verdict.GOOD

    def _stays(self, slot: Slot) -> int | None:
        """Bytes behind which the memory can be written on; None: the image has to come again."""
        try:
            return self._remembered.backing.begin_again(slot, self.state.slots[slot].received)
        except MediumError:
            return None

    def _transfer(self) -> tuple[Slot, SlotState]:
        if self._announced is None:
            raise OutOfOrderError("no image is announced: announce it first")
        return self._announced, self.state.slots[self._announced]


def _given_up(standing: SlotState) -> SlotState:
    return replace(standing, phase=SlotPhase.BAD, boots_left=0)
