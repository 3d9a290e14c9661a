"""An ECU behind the real server: two plain slots, and every way to go wrong on demand."""

import hashlib
from collections.abc import Generator
from dataclasses import dataclass, field, replace

from can_bridge.flashing import report
from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Slot
from can_bridge.flashing.report import Report, SlotReport
from can_bridge.flashing.state import Phase
from can_bridge.flashing.verdicts import Verdict
from can_bridge.tester.sequence import digest_of
from can_bridge.uds.refused import Refused
from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import Did, Nrc, Routine, Session
from contract.release import bundle
from contract.release.container import read_files
from contract.release.image import image_of
from contract.shipped import BUNDLE
from tests.can_bridge.flashing.store_ecu import KEY, VALUES, Counted

SHIPPED = image_of(read_files(BUNDLE))
TICK_NS = 20_000_000


@dataclass
class Held:
    """What a slot holds."""

    image: bytes = b""
    announced: tuple[int, bytes] = (0, b"")
    phase: Phase = Phase.EMPTY
    name: str = ""
    boots_left: int = 0

    def report(self) -> SlotReport:
        known = self.phase not in (Phase.EMPTY, Phase.FILLING)
        return SlotReport(
            phase=self.phase,
            name=self.name,
            digest=(digest_of(self.image) or hashlib.sha256(self.image).hexdigest()) if known else "",
            security_version=1 if known else 0,
            received=len(self.image),
            length=max(self.announced[0], len(self.image)),
            boots_left=self.boots_left,
            verdict=None,
        )


@dataclass
class Played:
    """What outlives a reset, and what is to go wrong.

    Attributes:
        verdict: of CHECK.
        starts: whether a release on trial boots.
        passes: whether it passes its self-test.
        in_use: the vehicle asks for control.
        is_dead: nothing is answered.
        dead_after: bytes of a transfer after which it is.
        resets_after: bytes of a transfer after which it resets itself, once.
    """

    running: Held = field(default_factory=Held)
    other: Held = field(default_factory=Held)
    verdict: Verdict = Verdict.GOOD
    starts: bool = True
    passes: bool = True
    in_use: bool = False
    is_dead: bool = False
    dead_after: int | None = None
    resets_after: int | None = None
    writing_ns: int = 0
    attempts: dict[Level, int] = field(default_factory=dict)
    dids: dict[Did, bytes] = field(default_factory=dict)
    resets: int = 0
    written: int = 0
    log: list[Routine] = field(default_factory=list)


def played() -> Played:
    """With a confirmed release named old, and room for the shipped one."""
    manifest = bundle.load(BUNDLE).manifest
    period_ns = manifest.operating_point.period_ns(manifest.control_period)
    dids = {Did.CAPACITY: (2**20).to_bytes(4, "big"), Did.PERIOD_NS: period_ns.to_bytes(8, "big")}
    old = SHIPPED[:100]
    running = Held(image=old, announced=(100, hashlib.sha256(old).digest()), phase=Phase.CONFIRMED, name="old")
    return Played(running=running, dids=VALUES | dids)


class PlayedEcu:
    """What outlives a reset is in `kept`."""

    def __init__(self, kept: Played) -> None:
        self.kept = kept
        self._random_bytes = Counted()
        self.power_on()

    @property
    def is_dead(self) -> bool:
        return self.kept.is_dead

    def power_on(self) -> None:
        self.is_reset = False
        self.server = UdsServer(self, KEY, self._random_bytes)

    def enter(self, session: Session) -> None:
        if session is Session.PROGRAMMING and self.kept.in_use:
            raise Refused(Nrc.CONDITIONS_NOT_CORRECT)

    def leave(self) -> None:
        pass

    def read(self, did: Did) -> bytes:
        if did is Did.STORE:
            kept = self.kept
            runs = kept.running.phase in (Phase.CONFIRMED, Phase.TRIAL)
            return report.encode(
                Report(
                    slots=(kept.running.report(), kept.other.report()),
                    running=Slot.A if runs else None,
                    active=Slot.A if kept.running.phase is Phase.CONFIRMED else None,
                    next_boot=None,
                    reason=None,
                    least_security_version=1,
                    key_list_version=1,
                    failed_attempts=dict.fromkeys(Level, 0),
                )
            )
        if did not in self.kept.dids:
            raise Refused(Nrc.OUT_OF_RANGE)
        return self.kept.dids[did]

    def write(self, did: Did, value: bytes) -> Generator[None, None, None]:
        raise Refused(Nrc.OUT_OF_RANGE)

    def routine(self, routine: Routine, option: bytes) -> Generator[None, None, bytes]:
        kept = self.kept
        kept.log.append(routine)
        yield
        match routine:
            case Routine.PRECONDITIONS:
                if kept.in_use:
                    raise Refused(Nrc.CONDITIONS_NOT_CORRECT)
            case Routine.ERASE:
                asked = int.from_bytes(option[:4], "big"), option[4:]
                if kept.other.announced != asked:
                    kept.other = Held(announced=asked, phase=Phase.FILLING)
                return len(kept.other.image).to_bytes(4, "big")
            case Routine.CHECK:
                verdict = kept.verdict
                if hashlib.sha256(kept.other.image).digest() != kept.other.announced[1]:
                    verdict = Verdict.WRONG_HASH
                kept.other = (
                    replace(kept.other, phase=Phase.CHECKED) if verdict is Verdict.GOOD else Held(phase=Phase.BAD)
                )
                return bytes([verdict])
            case Routine.ACTIVATE:
                if kept.other.phase not in (Phase.CHECKED, Phase.TRIAL):
                    raise Refused(Nrc.SEQUENCE_ERROR)
                kept.other = replace(kept.other, phase=Phase.TRIAL, boots_left=3)
            case Routine.SELF_TEST:
                if not kept.passes:
                    raise Refused(Nrc.PROGRAMMING_FAILURE)
            case Routine.CONFIRM:
                kept.running = replace(kept.running, phase=Phase.CONFIRMED, boots_left=0)
            case Routine.REVERT:
                kept.running, kept.other = kept.other, replace(kept.running, phase=Phase.BAD)
        return b""

    def download(self, offset: int, length: int) -> None:
        if offset != len(self.kept.other.image):
            raise Refused(Nrc.OUT_OF_RANGE)

    def transfer(self, data: bytes) -> Generator[None, None, None]:
        kept = self.kept
        kept.other = replace(kept.other, image=kept.other.image + data)
        kept.written += len(data)
        if kept.dead_after is not None and len(kept.other.image) >= kept.dead_after:
            kept.is_dead = True
        if kept.resets_after is not None and len(kept.other.image) >= kept.resets_after:
            kept.resets_after = None
            self.reset()
        for _ in range(kept.writing_ns // TICK_NS):
            yield

    def exit(self) -> Generator[None, None, None]:
        yield

    def failed_attempts(self, level: Level) -> int:
        return self.kept.attempts.get(level, 0)

    def keep_failed_attempts(self, level: Level, count: int) -> None:
        self.kept.attempts[level] = count

    def before_reset(self) -> None:
        pass

    def reset(self) -> None:
        kept = self.kept
        kept.resets += 1
        if kept.other.phase == Phase.TRIAL:
            if kept.starts:
                kept.running, kept.other = replace(kept.other, boots_left=kept.other.boots_left - 1), kept.running
            else:
                kept.other = replace(kept.other, phase=Phase.BAD)
        self.is_reset = True
