"""The steps that flash an ECU, on real buses and in virtual time.

After any interruption the ECU still has its old release. If `Flashing.run` is called again, it continues from the state
of the ECU: with an image that is partly transferred or not yet activated, or with a release on trial.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum, auto
from functools import cached_property
from pathlib import Path
from typing import Final

from can_bridge.flashing.report import SlotReport, StoreReport
from can_bridge.flashing.state import SlotPhase
from can_bridge.tester import transfer
from can_bridge.tester.asking import Asking
from can_bridge.tester.facts import EcuFacts, read_facts, read_store
from can_bridge.tester.messages import NoAnswerError, NotNowError, NotPassedError, RefusedError
from can_bridge.tester.transfer import OnProgress, Transfer, enter_programming, in_programming, in_session
from can_bridge.uds.services import Nrc, Routine, Session
from contract.errors import FlashError, StillwakeError
from contract.release import controller_image
from contract.release.container import files_of
from contract.release.manifest import MANIFEST, open_manifest

RESTART_S: Final = 30.0
"""Longest wait in s for an ECU after a reset."""
THERE_S: Final = 3.0
"""Longest wait in s for the first answer of an ECU that should be running."""
RESET_S: Final = 0.5
"""Time in s from the answer to a reset until the ECU has stopped."""
RESETS: Final = 3
"""Number of resets after which the tester gives up if the ECU does not start the new release."""
Step = Enum("Step", "IDENTIFY PRECONDITIONS TRANSFER ACTIVATE RESET SELF_TEST CONFIRM")


class End(Enum):
    """The result of flashing without an error."""

    WOULD_FLASH = auto()
    """A dry run found no reason against flashing."""
    ALREADY = auto()
    """The release was already running and confirmed."""
    ON_TRIAL = auto()
    """The release runs and was not confirmed, as requested."""
    CONFIRMED = auto()


@dataclass(frozen=True)
class Flashed:
    """The report on one run of `Flashing`. `resumed_from` is the number of bytes that the ECU had before the transfer,
    None without a transfer; `attempts` counts announcements, `unanswered` requests repeated for want of an answer."""

    end: End
    before: EcuFacts
    after: StoreReport
    resumed_from: int | None
    attempts: int
    unanswered: int
    seconds: float


def reset_and_wait(asking: Asking) -> None:
    """Reset an ECU that is in the programming session, and wait until it answers in the default session."""
    for _ in range(RESETS):
        # An error does not matter: the answer may be lost, or the ECU may already be resetting.
        with suppress(NoAnswerError, RefusedError):
            asking.reset()
        # The ECU answers before it resets, so it may still be running.
        asking.sleep(RESET_S)
        if asking.wait_until_there(RESTART_S, "start again after the reset") is Session.DEFAULT:
            return
    raise NoAnswerError("start again after the reset")


@dataclass(frozen=True)
class Flashing:
    """The steps that bring a release to an ECU.

    Attributes:
        image: image of the release, as built by `contract.release.container`.
        dry_run: whether to stop before anything is written; this needs no key.
        confirm: whether to confirm the release; otherwise it stays on trial.
        judge: function of the ECU's properties that raises FlashError if this ECU must not get this image.
    """

    asking: Asking
    image: bytes
    dry_run: bool = False
    confirm: bool = True
    judge: Callable[[EcuFacts], None] = lambda facts: None
    progress: OnProgress = lambda received, length: None
    on_step: Callable[[Step], None] = lambda step: None

    def run(self) -> Flashed:
        """Transfer the image to the ECU, start it, test it and confirm it. Raises a FlashError of
        `can_bridge.tester.messages`; BusError if the bus failed."""
        asking, attempts = self.asking, 0
        began = asking.clock()
        resumed_from: int | None = None
        self.on_step(Step.IDENTIFY)
        asking.wait_until_there(THERE_S, "report its session")
        before = read_facts(asking)
        after = before.store

        def ended(end: End) -> Flashed:
            asking.session(Session.DEFAULT)
            return Flashed(end, before, after, resumed_from, attempts, asking.unanswered, asking.clock() - began)

        if self._is_ours(after.running_slot) and after.running == after.active:
            return ended(End.ALREADY)
        self.judge(before)
        self.on_step(Step.PRECONDITIONS)
        in_session(lambda: asking.session(Session.EXTENDED), lambda: asking.routine(Routine.PRECONDITIONS))
        if self.dry_run:
            return ended(End.WOULD_FLASH)
        running = after.running_slot
        if running is None or not self._is_ours(running) or running.phase is not SlotPhase.TRIAL:
            resumed_from, attempts = self._bring()
        after = self._try_out()
        if not self.confirm:
            return ended(End.ON_TRIAL)
        self.on_step(Step.CONFIRM)
        after = self._confirm()
        return ended(End.CONFIRMED)

    def _bring(self) -> tuple[int, int]:
        try:
            self.asking.quieten()
            self.on_step(Step.TRANSFER)
            transferred = Transfer(self.asking, self.image, self.progress).run()
            self.on_step(Step.ACTIVATE)
            try:
                in_programming(self.asking, Routine.ACTIVATE)
            except RefusedError as refused:
                # If the ECU lost power right after it carried out the request, it has already booted the new release.
                if refused.code != Nrc.SEQUENCE_ERROR or not self._is_ours(read_store(self.asking).running_slot):
                    raise
                return transferred
        except (FlashError, KeyboardInterrupt):
            # After an announcement, only a reset lets the jets run again. The ECU's old release then runs.
            with suppress(FlashError):
                self.asking.session(Session.PROGRAMMING)
                self.asking.reset()
            raise
        self._start()
        return transferred

    def _start(self) -> None:
        for _ in range(RESETS):
            self.on_step(Step.RESET)
            reset_and_wait(self.asking)
            store = read_store(self.asking)
            if self._is_ours(store.running_slot):
                return
            if not any(self._is_ours(slot) and slot.phase is SlotPhase.TRIAL for slot in store.slots):
                break
            enter_programming(self.asking)
        raise NotPassedError(f"the ECU did not start the new release; {_runs(store)}")

    def _try_out(self) -> StoreReport:
        """Run the self-test of the release on trial; if it fails, return to the previous release."""
        self.on_step(Step.SELF_TEST)
        try:
            enter_programming(self.asking)
        except NotNowError as refused:
            raise NotNowError(
                f"the new release runs on trial, and was not confirmed: {refused}; the same command continues with it"
            ) from refused
        try:
            in_programming(self.asking, Routine.SELF_TEST)
        except RefusedError as refused:
            enter_programming(self.asking)
            in_programming(self.asking, Routine.REVERT)
            reset_and_wait(self.asking)
            runs = _runs(read_store(self.asking))
            raise NotPassedError(f"the new release did not pass its self-test; {runs} again") from refused
        return read_store(self.asking)

    def _confirm(self) -> StoreReport:
        for left in reversed(range(transfer.TRIES)):
            try:
                in_programming(self.asking, Routine.CONFIRM)
                break
            except RefusedError as refused:
                store = read_store(self.asking)
                running = store.running_slot
                if refused.code != Nrc.SEQUENCE_ERROR or running is None or not self._is_ours(running):
                    raise
                # If the ECU lost power right after it carried out the request, the release is already confirmed.
                if store.running == store.active:
                    return store
                # If the ECU lost power before it carried out the request, it first needs another self-test.
                if running.phase is not SlotPhase.TRIAL or not left:
                    raise
            self._try_out()
        return read_store(self.asking)

    def _is_ours(self, slot: SlotReport | None) -> bool:
        return slot is not None and slot.digest == self._digest != ""

    @cached_property
    def _digest(self) -> str:
        """The digest of the image's release; empty for an invalid image, so that the ECU can give its own verdict."""
        with suppress(StillwakeError):
            return controller_image.read(self.image).digest
        with suppress(KeyError, StillwakeError):
            return open_manifest(Path("image"), files_of(self.image)[MANIFEST]).digest
        return ""


def _runs(store: StoreReport) -> str:
    running = store.running_slot
    return "no release runs" if running is None else f"{running.name} runs"
