"""The two slots for releases, one for the running release and one for a new image, and the ECU's rules for releases.

The store has no clock, no randomness and no thread. A loss of power may interrupt any call. The next boot uses the
state stored by then, and finds a valid image if there was a valid image before.

    announce, append .., finish     write an image to the slot that may be overwritten, and check it there
    activate                        boot the image from the next reset on, up to `TRIAL_BOOTS` times
    confirm                         end the trial, and raise the least security version to the release's version
    revert                          return to the previous release

The store never writes to a slot whose confirmed image is running or boots next.
"""

import hashlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

from can_bridge.flashing.backing import Long, MediumError, RecordKind, Slot, at_once
from can_bridge.flashing.checking import Release
from can_bridge.flashing.remembered import PIECE, Remembered, encode_calibrations
from can_bridge.flashing.state import TRANSFERRED, TRIAL_BOOTS, SlotPhase, SlotState, StoreState
from can_bridge.flashing.verdicts import InWords, Verdict
from contract.errors import BusError, ConfigError, KeyFileError
from contract.release import key_list
from contract.release.signing import PublicKey


class OutOfOrderError(BusError):
    """The error for a request that does not fit the store's present state."""


class BootReason(InWords):
    CONFIRMED = 1, "confirmed"
    TRIAL = 2, "on trial"
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


class Store(Remembered):
    """The store of releases, from one power-on to the next power-on. Its methods raise MediumError if the memory fails.

    Attributes:
        last_boot: the result of `boot`; None before the first call.
        running: the booted slot; None without a release, or after another image was announced for this slot.
    """

    last_boot: Boot | None = None
    running: Slot | None = None
    _announced: Slot | None = None
    """The slot of the transfer in progress; the next bytes are appended to the bytes that the slot has."""

    def provision(self, keys: bytes, image: bytes | None) -> None:
        """Fill a new ECU's empty memory with a key list and with a confirmed image in slot A. Raises OutOfOrderError if
        a release is confirmed; KeyFileError if the root key did not sign the list; ConfigError for an invalid image."""
        if self.state.active is not None:
            raise OutOfOrderError("the store has a confirmed release: it must be empty to be provisioned")
        if self.backing.records().get(RecordKind.KEYS) != keys:
            self.take_keys(keys)
        if image is not None:
            at_once(self.announce(len(image), hashlib.sha256(image).digest()))
            for at in range(self.received or 0, len(image), PIECE):
                self.append(image[at : at + PIECE])
            if (verdict := at_once(self.finish())) != Verdict.GOOD:
                raise ConfigError(f"image: {verdict.in_words}; must be a bundle for this ECU")
            self._confirm(Slot.A)

    @property
    def received(self) -> int | None:
        """The number of stored bytes of the announced image; None if no image is announced."""
        return None if self._announced is None else self.state.slots[self._announced].received

    def boot(self) -> Boot:
        """Choose an image and check it completely; a trial's boot is counted first. Damaged memory raises nothing."""
        self._announced = None
        trial = self.state.on_trial
        verdicts: dict[Slot, Verdict] = {}
        on_trial = None if trial is None else self._boot_trial(trial, verdicts)
        self.last_boot = on_trial or self._boot_confirmed(trial is not None, verdicts)
        self.running = self.last_boot.slot
        return self.last_boot

    def _boot_trial(self, slot: Slot, verdicts: dict[Slot, Verdict]) -> Boot | None:
        """Return the trial image's boot. If this image has no boot left or fails a check, reject it and return None."""
        standing = self.state.slots[slot]
        try:
            if standing.boots_left > 0:
                # The boot is counted before the image runs, so that it is also counted if the image crashes.
                left = standing.boots_left - 1
                self.keep_slot(slot, replace(standing, boots_left=left))
                verdicts[slot], bundle = at_once(self.judged(slot))
                if bundle is not None:
                    return Boot(slot=slot, bundle=bundle, verdicts=verdicts, reason=BootReason.TRIAL, boots_left=left)
            self.keep_slot(slot, _given_up(standing))
        except MediumError:
            # If the boot cannot be counted, the image is not run, because the trial would never end.
            verdicts.setdefault(slot, Verdict.UNREADABLE)
        return None

    def _boot_confirmed(self, is_reverted: bool, verdicts: dict[Slot, Verdict]) -> Boot:
        """Return the boot of the confirmed image, or of the image confirmed before it. An image that fails a check
        stays confirmed: it can boot again when wrong vehicle data or a wrong stillwake.dbc in the ECU is corrected."""
        active = self.state.active
        for slot in () if active is None else (active, active.other):
            if self.state.slots[slot].phase != SlotPhase.CONFIRMED:
                continue
            verdicts[slot], bundle = at_once(self.judged(slot))
            if bundle is not None:
                expected = BootReason.REVERTED if is_reverted else BootReason.CONFIRMED
                reason = expected if slot == active else BootReason.FALLBACK
                return Boot(slot=slot, bundle=bundle, verdicts=verdicts, reason=reason)
        return Boot(verdicts=verdicts, reason=BootReason.NO_RELEASE)

    def announce(self, length: int, sha256: bytes) -> Long[int]:
        """Prepare a slot for an image. Returns the offset of the first byte to send: 0 for a new image, and `length` if
        all bytes are stored. After an interrupted transfer of this image, the offset is the number of bytes received,
        or less if the memory can only continue from an earlier byte. Raises ConfigError for a length or hash out of
        range; OutOfOrderError if `revert` selected another release and the ECU was not reset since."""
        if not 0 < length <= self.backing.capacity:
            raise ConfigError(f"the image has {length} bytes: must have 1 to {self.backing.capacity} for this ECU")
        if len(sha256) != 32:
            raise ConfigError(f"the image's SHA-256 has {len(sha256)} bytes: must have 32")
        slot = self._writable_slot()
        standing = self.state.slots[slot]
        self._announced = None
        if self.running == slot:
            self.running = None
        stays: int | None = None
        is_same = standing.phase in TRANSFERRED and (standing.length, standing.sha256) == (length, sha256)
        if is_same and not self._is_known_bad(slot):
            with suppress(MediumError):
                stays = self.backing.begin_again(slot, standing.received)
        wanted = stays or 0
        announced = SlotState(phase=SlotPhase.FILLING, length=length, sha256=sha256, received=wanted)
        if stays is None or stays < standing.received:
            # The new state is stored before the slot is erased, so that erased bytes never count as received.
            self.keep(self._without(slot).with_slot(slot, announced if stays else SlotState()))
            yield from self.backing.clear(slot, wanted)
        if announced != self.state.slots[slot]:
            self.keep(self._without(slot).with_slot(slot, announced))
        self._announced = slot
        return wanted

    def append(self, data: bytes) -> None:
        """Append bytes to the announced image. After the call they survive a loss of power. Raises OutOfOrderError if
        no image is announced, or for bytes beyond its length. After a MediumError, announce the image again."""
        slot, standing = self._transfer()
        if standing.phase != SlotPhase.FILLING or standing.received + len(data) > standing.length:
            raise OutOfOrderError(
                f"{len(data)} more bytes are too many: {standing.received} of the image's {standing.length} are stored"
            )
        self._announced = None
        self.backing.append(slot, data)
        self.keep_slot(slot, replace(standing, received=standing.received + len(data)))
        self._announced = slot

    def finish(self) -> Long[Verdict]:
        """Check the announced image in the memory. GOOD changes the phase to CHECKED, INCOMPLETE changes nothing, other
        verdicts change it to BAD. May be repeated until the activation. Raises OutOfOrderError without an image."""
        slot, standing = self._transfer()
        if standing.received < standing.length:
            return Verdict.INCOMPLETE
        verdict, bundle = yield from self.judged(slot)
        phase = SlotPhase.BAD if bundle is None else SlotPhase.CHECKED
        checked = SlotState(phase=phase, length=standing.length, sha256=standing.sha256, received=standing.received)
        if bundle is not None:
            signer = b"" if bundle.signer is None else bundle.signer.raw
            checked = replace(
                checked, digest=bundle.digest, name=bundle.name, security_version=bundle.security_version, signer=signer
            )
        if checked != standing:
            self.keep_slot(slot, checked)
        return verdict

    def drop(self) -> None:
        """End the transfer when its session ends; the next announcement of the same image continues the transfer."""
        self._announced = None

    def activate(self) -> None:
        """Activate the checked image: it boots on trial from the next reset on. Does nothing if the image is already
        activated. Raises OutOfOrderError if no image is checked."""
        state, slot, trial = self.state, self.state.checked, self.state.on_trial
        if slot is None:
            if trial is not None and trial != self.running:
                return
            raise OutOfOrderError("no image to activate: transfer and check an image first")
        if trial is not None:
            state = state.with_slot(trial, _given_up(state.slots[trial]))
        self.keep(state.with_slot(slot, replace(state.slots[slot], phase=SlotPhase.TRIAL, boots_left=TRIAL_BOOTS)))
        self._announced = None

    def confirm(self) -> None:
        """Confirm the release that runs on trial; may be repeated. Raises OutOfOrderError if no release runs, if it is
        neither on trial nor confirmed any more, or if the key that signed it may no longer sign."""
        slot = self.running
        phase = None if slot is None else self.state.slots[slot].phase
        if slot is None or phase not in (SlotPhase.TRIAL, SlotPhase.CONFIRMED):
            raise OutOfOrderError("no release to confirm: an activated release must run")
        if phase == SlotPhase.TRIAL:
            if self.keys is None or PublicKey(self.state.slots[slot].signer) not in self.keys.keys:
                # Such a release would not boot again, and its confirmation may make the previous release too old.
                raise OutOfOrderError("the key that signed the release on trial is not in the list: revert the release")
            self._confirm(slot)

    def _confirm(self, slot: Slot) -> None:
        standing = self.state.slots[slot]
        confirmed = replace(standing, phase=SlotPhase.CONFIRMED, boots_left=0)
        least = max(self.state.least_security_version, standing.security_version)
        self.keep(self.state.with_slot(slot, confirmed, active=slot, least_security_version=least))

    def revert(self) -> Long[Verdict]:
        """Select the release that the next reset starts: the confirmed one during a trial, otherwise the other slot's.
        Returns GOOD, or why it may no longer run; then nothing changes. Raises OutOfOrderError if there is none."""
        trial, active = self.state.on_trial, self.state.active
        if trial is not None:
            self.keep_slot(trial, _given_up(self.state.slots[trial]))
            return Verdict.GOOD
        # The release is always taken from the slot that does not run, even if this slot is already active: if the
        # answer to a first request is lost, the repeated request must not undo the first request.
        now = self.running if self.running is not None else active
        if now is None or self.state.slots[now.other].phase != SlotPhase.CONFIRMED:
            raise OutOfOrderError("no release to revert to: none is on trial, and no earlier release was confirmed")
        verdict, _ = yield from self.judged(now.other)
        if verdict == Verdict.GOOD and active != now.other:
            self.keep(replace(self.state, active=now.other))
        return verdict

    def take_keys(self, raw: bytes) -> None:
        """Replace the key list. Raises KeyFileError if the new list is not signed by the root key, is not newer, or
        lacks the signing key of the active or the running confirmed release, which could then not boot."""
        listed = key_list.decode(raw, self._root)
        if self.keys is not None:
            if listed.version <= self.keys.version:
                raise KeyFileError(
                    f"key list: version {listed.version} must be greater than {self.keys.version}, this ECU's version"
                )
            for slot in (self.state.active, self.running):
                standing = SlotState() if slot is None else self.state.slots[slot]
                if standing.phase != SlotPhase.CONFIRMED:
                    continue
                signer = PublicKey(standing.signer)
                if signer in self.keys.keys - listed.keys:
                    raise KeyFileError(
                        f"key list: lacks key {signer.fingerprint}, which signed the confirmed release; first confirm "
                        "a release that another key has signed"
                    )
        self.backing.keep(RecordKind.KEYS, raw)
        self.keys = listed

    def keep_calibration(self, blob: bytes | None) -> None:
        """Store the running release's calibration, or remove it if `blob` is None. Calibrations of releases that are
        in no slot are removed, too. Raises OutOfOrderError if no release runs; ConfigError for a wrong length."""
        if self.running is None:
            raise OutOfOrderError("no release for the calibration: a release must run")
        running = self.state.slots[self.running].digest
        here = {slot.digest for slot in self.state.slots} - {running}
        kept = {digest: kept for digest, kept in self._calibrations.items() if digest in here}
        if blob is not None:
            kept[running] = blob
        try:
            record = encode_calibrations(kept)
        except ValueError as error:
            raise ConfigError(str(error)) from error
        self.backing.keep(RecordKind.CALIBRATION, record)
        self._calibrations = kept

    def _writable_slot(self) -> Slot:
        """Return the slot to write. The other slot has the confirmed release that runs, or else the active release."""
        running, active = self.running, self.state.active
        if running is None or (active is not None and self.state.slots[running].phase != SlotPhase.CONFIRMED):
            return Slot.A if active is None else active.other
        if active is not None and running != active and not self._is_known_bad(active):
            raise OutOfOrderError("the previous release boots at the next reset: reset the ECU first")
        return running.other

    def _without(self, slot: Slot) -> StoreState:
        """Return the state with this slot empty, and the other slot active if it has a confirmed release."""
        is_confirmed = self.state.slots[slot.other].phase == SlotPhase.CONFIRMED
        return self.state.with_slot(slot, SlotState(), active=slot.other if is_confirmed else None)

    def _is_known_bad(self, slot: Slot) -> bool:
        """Return whether the slot's image failed the checks of the last boot, so that it has to be sent again."""
        found = {} if self.last_boot is None else self.last_boot.verdicts
        was_booted = self.state.slots[slot].phase in (SlotPhase.TRIAL, SlotPhase.CONFIRMED)
        return was_booted and found.get(slot, Verdict.GOOD) != Verdict.GOOD

    def _transfer(self) -> tuple[Slot, SlotState]:
        if self._announced is None:
            raise OutOfOrderError("no image is announced: announce an image first")
        return self._announced, self.state.slots[self._announced]


def _given_up(standing: SlotState) -> SlotState:
    return replace(standing, phase=SlotPhase.BAD, boots_left=0)
