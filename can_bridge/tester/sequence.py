"""Flashing an ECU, as steps over an open udsoncan client: the same code for a bus, a bench in virtual time, and a test.

Nothing here prints, sleeps or reads a clock by itself. Whatever interrupts it leaves an ECU with the release that it
had; running it again goes on where the ECU stands: a half-transferred image, one that was not activated, one that runs
on trial.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum, auto
from pathlib import Path
from typing import TYPE_CHECKING, Final

from can_bridge.flashing.report import SlotReport, StoreReport
from can_bridge.flashing.state import SlotPhase
from can_bridge.tester.asking import Asking, KeyOf
from can_bridge.tester.facts import EcuFacts, read_facts, read_store
from can_bridge.tester.messages import NoAnswerError, NotNowError, NotPassedError, RefusedError
from can_bridge.tester.transfer import (
    SESSION_ENDED,
    TRIES,
    OnProgress,
    Transfer,
    Transferred,
    enter_programming,
    in_programming,
)
from can_bridge.uds.services import Nrc, Routine, Session
from contract.errors import FlashError, StillwakeError
from contract.release import controller_image
from contract.release.image import files_of
from contract.release.manifest import MANIFEST, open_manifest

if TYPE_CHECKING:
    from udsoncan.client import Client

RESTART_S: Final = 30.0
"""The wait for an ECU to come back from a reset."""
THERE_S: Final = 3.0
"""The wait for the first answer."""
RESET_S: Final = 0.5
"""The time from the answer to a reset until the ECU is gone."""
RESETS: Final = 3
"""That are asked for before an ECU counts as one that does not start the new release."""


class Step(Enum):
    """What is being done, for whoever shows it."""

    IDENTIFY = auto()
    PRECONDITIONS = auto()
    TRANSFER = auto()
    ACTIVATE = auto()
    RESET = auto()
    SELF_TEST = auto()
    CONFIRM = auto()


class End(Enum):
    """How it ended."""

    WOULD_FLASH = auto()
    """Dry run: nothing stands against it."""
    ALREADY = auto()
    """The release ran before, and was confirmed."""
    ON_TRIAL = auto()
    """It runs and was not confirmed, as was asked for."""
    CONFIRMED = auto()


@dataclass(frozen=True, kw_only=True)
class FlashOptions:
    """What to leave out.

    Attributes:
        dry_run: everything that writes nothing.
        confirm: whether to, after the self-test.
    """

    dry_run: bool = False
    confirm: bool = True


@dataclass(frozen=True, kw_only=True)
class Flashed:
    """How it went.

    Attributes:
        transferred: None if nothing had to be.
        unanswered: requests that were sent again for want of an answer.
        seconds: by the clock that was given.
    """

    end: End
    before: EcuFacts
    after: StoreReport
    transferred: Transferred | None = None
    unanswered: int = 0
    seconds: float = 0.0


def flash(
    client: Client,
    image: bytes,
    *,
    key: KeyOf | None,
    options: FlashOptions = FlashOptions(),
    judge: Callable[[EcuFacts], None] = lambda facts: None,
    progress: OnProgress = lambda received, length: None,
    on_step: Callable[[Step], None] = lambda step: None,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Flashed:
    """Bring an image into an ECU, start it, test it and confirm it. Raises FlashError, by its kinds in
    `can_bridge.tester.messages`; BusError if the bus failed.

    Args:
        client: open; its settings are made here.
        image: as `contract.release.image` makes it.
        key: answers a seed of the programming level; a dry run needs none.
        judge: raises FlashError if the ECU, by what it reports of itself, must not be flashed with this image.
        progress: called with every block.
        on_step: called with every step.
        clock, sleep: seconds.
    """
    began = clock()
    asking = Asking(client, key=key, clock=clock, sleep=sleep)
    return _Flashing(asking, image, options, judge, progress, on_step).run(lambda: clock() - began)


def reset_and_wait(asking: Asking) -> None:
    """Restart an ECU that is in the programming session, and wait until it answers in the default session."""
    for _ in range(RESETS):
        # The answer may be lost, or the ECU be busy with the reset already.
        with suppress(NoAnswerError, RefusedError):
            asking.reset(times=1)
        # It answers before it does it.
        asking.wait(RESET_S, keep_session=False)
        if asking.wait_until_there(RESTART_S, "start again after the reset") is Session.DEFAULT:
            return
    raise NoAnswerError("start again after the reset")


class _Flashing:
    def __init__(
        self,
        asking: Asking,
        image: bytes,
        options: FlashOptions,
        judge: Callable[[EcuFacts], None],
        progress: OnProgress,
        on_step: Callable[[Step], None],
    ) -> None:
        self._asking = asking
        self._image = image
        self._digest = digest_of(image)
        self._options = options
        self._judge = judge
        self._progress = progress
        self._on_step = on_step

    def run(self, elapsed: Callable[[], float]) -> Flashed:
        asking, transferred = self._asking, None
        self._on_step(Step.IDENTIFY)
        asking.wait_until_there(THERE_S, "report its session")
        before = read_facts(asking)
        after = before.store

        def ended(end: End) -> Flashed:
            return Flashed(
                end=end,
                before=before,
                after=after,
                transferred=transferred,
                unanswered=asking.unanswered,
                seconds=elapsed(),
            )

        if self._is_ours(after.running_slot) and after.running == after.active:
            asking.session(Session.DEFAULT)
            return ended(End.ALREADY)
        self._judge(before)
        self._on_step(Step.PRECONDITIONS)
        self._check_preconditions()
        if self._options.dry_run:
            asking.session(Session.DEFAULT)
            return ended(End.WOULD_FLASH)
        running = after.running_slot
        if running is None or not self._is_ours(running) or running.phase is not SlotPhase.TRIAL:
            transferred = self._bring()
        after = self._try_out()
        if not self._options.confirm:
            asking.session(Session.DEFAULT)
            return ended(End.ON_TRIAL)
        self._on_step(Step.CONFIRM)
        after = self._confirm()
        asking.session(Session.DEFAULT)
        return ended(End.CONFIRMED)

    def _check_preconditions(self) -> None:
        for left in reversed(range(TRIES)):
            self._asking.session(Session.EXTENDED)
            try:
                self._asking.routine(Routine.PRECONDITIONS)
                return
            except RefusedError as refused:
                if refused.code not in SESSION_ENDED or not left:
                    raise

    def _bring(self) -> Transferred:
        """The image into the ECU, and started on trial."""
        try:
            self._asking.quieten()
            self._on_step(Step.TRANSFER)
            transferred = Transfer(self._asking, self._image, self._progress).run()
            self._on_step(Step.ACTIVATE)
            if self._activate():
                return transferred
        except (FlashError, KeyboardInterrupt):
            self._leave()
            raise
        self._start()
        return transferred

    def _activate(self) -> bool:
        """Have the image booted from the next reset on; whether it runs already."""
        try:
            in_programming(self._asking, Routine.ACTIVATE)
        except RefusedError as refused:
            # Power may be lost as soon as the request was carried out, and the next boot be that of the new release.
            if refused.code != Nrc.SEQUENCE_ERROR or not self._is_ours(read_store(self._asking).running_slot):
                raise
            return True
        return False

    def _start(self) -> None:
        """Reset until the activated image runs."""
        for _ in range(RESETS):
            self._on_step(Step.RESET)
            reset_and_wait(self._asking)
            store = read_store(self._asking)
            if self._is_ours(store.running_slot):
                return
            if not any(self._is_ours(slot) and slot.phase is SlotPhase.TRIAL for slot in store.slots):
                break
            enter_programming(self._asking)
        raise NotPassedError(f"the ECU did not start the new release; {_runs(store)}")

    def _try_out(self) -> StoreReport:
        """Self-test of the release that runs on trial; where it does not pass, back to the one before."""
        self._on_step(Step.SELF_TEST)
        try:
            enter_programming(self._asking)
        except NotNowError as refused:
            raise NotNowError(
                f"the new release runs on trial, and was not confirmed: {refused}; the same command goes on with it"
            ) from refused
        try:
            in_programming(self._asking, Routine.SELF_TEST)
        except RefusedError as refused:
            store = self._go_back()
            raise NotPassedError(f"the new release did not pass its self-test; {_runs(store)} again") from refused
        return read_store(self._asking)

    def _confirm(self) -> StoreReport:
        """Keep the release that runs; the store afterwards."""
        for left in reversed(range(TRIES)):
            try:
                in_programming(self._asking, Routine.CONFIRM)
                break
            except RefusedError as refused:
                store = read_store(self._asking)
                running = store.running_slot
                if refused.code != Nrc.SEQUENCE_ERROR or running is None or not self._is_ours(running):
                    raise
                # Power may be lost as soon as the request was carried out: then there is no trial any more.
                if store.running == store.active:
                    return store
                # Or before it: an ECU confirms what passed its self-test since it booted.
                if running.phase is not SlotPhase.TRIAL or not left:
                    raise
            self._try_out()
        return read_store(self._asking)

    def _go_back(self) -> StoreReport:
        """Go back from a trial to the confirmed release."""
        enter_programming(self._asking)
        in_programming(self._asking, Routine.REVERT)
        reset_and_wait(self._asking)
        return read_store(self._asking)

    def _leave(self) -> None:
        """Let the ECU go back to the release it has: once a transfer has begun only a reset leads out."""
        with suppress(FlashError):
            self._asking.session(Session.PROGRAMMING)
            self._asking.reset(times=1)

    def _is_ours(self, slot: SlotReport | None) -> bool:
        return slot is not None and slot.digest == self._digest != ""


def digest_of(image: bytes) -> str:
    """The digest of the release in an image; empty for what is none, so that the ECU's own verdict on it can be had."""
    with suppress(StillwakeError):
        return controller_image.read(image).digest
    with suppress(KeyError, StillwakeError):
        return open_manifest(Path("image"), files_of(image)[MANIFEST]).digest
    return ""


def _runs(store: StoreReport) -> str:
    running = store.running_slot
    return "no release runs" if running is None else f"{running.name} runs"
