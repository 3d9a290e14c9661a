"""An ECU in virtual time behind the real server: two plain slots, and every way to go wrong on demand."""

import hashlib
from collections import deque
from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace

from udsoncan.exceptions import TimeoutException

from can_bridge.flashing import report
from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Slot
from can_bridge.flashing.medium import PowerCut
from can_bridge.flashing.report import Report, SlotReport
from can_bridge.flashing.state import Phase
from can_bridge.flashing.verdicts import Verdict
from can_bridge.tester.direct_connection import DirectConnection
from can_bridge.tester.matching import answers
from can_bridge.tester.sequence import digest_of
from can_bridge.uds.access_key import AccessKey
from can_bridge.uds.diagnostics import Diagnostics
from can_bridge.uds.refused import Refused
from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import Did, Nrc, Routine, Session

SECRET = bytes(range(1, 17))
NS = 1_000_000_000
TICK_NS = 20_000_000


class VirtualTime:
    """Seconds that pass only when somebody waits."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.on_tick: Callable[[], None] = lambda: None

    def clock(self) -> float:
        return self.now_ns / NS

    def sleep(self, seconds: float) -> None:
        until = self.now_ns + round(seconds * NS)
        while self.now_ns < until:
            self.now_ns = min(until, self.now_ns + TICK_NS)
            self.on_tick()


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


class PlayedEcu:
    """Diagnostics for the server."""

    def __init__(self, kept: Played, on_reset: Callable[[], None]) -> None:
        self.kept = kept
        self._on_reset = on_reset

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
        self._on_reset()


class Line(DirectConnection):
    """A tester's connection to the ECU, by payloads.

    Attributes:
        lose: called with each payload, to the ECU (True) and from it: whether it is lost.
        double: whether each payload from the ECU comes twice.
        heard: all requests that reached the ECU.
        cuts: losses of power in the middle of a write.
    """

    def __init__(
        self,
        kept: Played,
        time: VirtualTime,
        made: Callable[[Callable[[], None]], Diagnostics] | None = None,
    ) -> None:
        """Args: made: makes the ECU at power-on, told what to call for a reset; the played one by default."""
        super().__init__()
        self._made = made or (lambda on_reset: PlayedEcu(kept, on_reset))
        self.kept = kept
        self.time = time
        self.lose: Callable[[bytes, bool], bool] = lambda payload, to_ecu: False
        self.double = False
        self.heard: list[bytes] = []
        self.cuts = 0
        self._seeds = 0
        self._request = b""
        self._waiting: deque[bytes] = deque()
        time.on_tick = self._tick
        self.power_on()

    def power_on(self) -> None:
        """Also after a loss of power, at any time."""
        self.server = UdsServer(self._made(self.power_on), AccessKey(SECRET), self._random)

    def _random(self, count: int) -> bytes:
        self._seeds += 1
        return self._seeds.to_bytes(count, "big")

    def arrive(self, payload: bytes) -> None:
        """Let a payload come from the ECU, whatever it is."""
        self._waiting.append(payload)

    def empty_rxqueue(self) -> None:
        self._waiting.clear()

    def specific_send(self, payload: bytes, timeout: float | None = None) -> None:
        self._request = payload
        if not self.lose(payload, True) and not self.kept.is_dead:
            self.heard.append(payload)
            self._take(lambda: self.server.request(self.time.now_ns, payload))

    def specific_wait_frame(self, timeout: float | None = None) -> bytes:
        until = self.time.now_ns + round((timeout or 0.0) * NS)
        while self.time.now_ns <= until:
            while self._waiting:
                payload = self._waiting.popleft()
                if answers(self._request, payload):
                    return payload
            self.time.sleep(TICK_NS / NS)
        raise TimeoutException

    def _tick(self) -> None:
        if not self.kept.is_dead:
            self._take(lambda: self.server.tick(self.time.now_ns))

    def _take(self, work: Callable[[], list[bytes]]) -> None:
        try:
            payloads = work()
        except PowerCut:
            self.cuts += 1
            self.power_on()
            return
        for payload in payloads:
            if not self.lose(payload, False) and not self.kept.is_dead:
                self._waiting.extend([payload] * (1 + self.double))
