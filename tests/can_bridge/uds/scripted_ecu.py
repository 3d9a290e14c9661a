"""An ECU behind the server whose answers a test decides, and that notes what it is asked."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, cast

from can_bridge.flashing.backing import Long
from can_bridge.flashing.state import Level
from can_bridge.uds.fault_memory import FaultMemory
from can_bridge.uds.security import AccessKey
from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import Did, Nrc, Refused, Routine, Session

SECRET = bytes.fromhex("2b7e151628aed2a6abf7158809cf4f3c")
MS = 1_000_000
S = 1000 * MS


class ScriptedEcu:
    """Has any method, and notes calls as tuples of name and arguments; refuses those that `refusals` names; works in
    `pieces` pieces."""

    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []
        self.refusals: dict[str, Nrc] = {}
        self.pieces = 0
        self.values = {Did.SERIAL_NUMBER: b"0815", Did.HARDWARE: b"bench", Did.CAPACITY: bytes(4)}
        self.status = b""
        self.attempts = dict.fromkeys(Level, 0)

    def __getattr__(self, name: str) -> Callable[..., None]:
        return partial(self._note, name)

    def read(self, did: Did) -> bytes:
        self._note("read", did)
        if did not in self.values:
            raise Refused(Nrc.OUT_OF_RANGE)
        return self.values[did]

    def routine(self, routine: Routine, option: bytes) -> Long[bytes]:
        yield from self._work("routine", routine, option)
        return self.status

    def transfer(self, data: bytes) -> Long[None]:
        return self._work("transfer", data)

    def failed_attempts(self, level: Level) -> int:
        return self.attempts[level]

    def keep_failed_attempts(self, level: Level, count: int) -> None:
        self._note("keep", level, count)
        self.attempts[level] = count

    def _note(self, *call: Any) -> None:
        self.calls.append(call)
        if call[0] in self.refusals:
            raise Refused(self.refusals[call[0]])

    def _work(self, *call: Any) -> Long[None]:
        for _ in range(self.pieces):
            yield
        self._note(*call)


class Bench:
    """A server, the ECU behind it, and a clock. Seeds are `seeds`, then numbers that are counted up."""

    def __init__(self, ecu: ScriptedEcu | None = None, *, faults: FaultMemory | None = None, now_ns: int = 0) -> None:
        self.ecu = ecu or ScriptedEcu()
        self.key = AccessKey(SECRET)
        self.now_ns = now_ns
        self.seeds: list[bytes] = []
        self._drawn = 0
        self.server = UdsServer(cast(Any, self.ecu), self.key, self._random_bytes, faults or FaultMemory())

    def ask(self, *parts: int | bytes | Sequence[int]) -> bytes | None:
        """The one answer to a request, None if there was none."""
        request = b"".join(bytes([part]) if isinstance(part, int) else bytes(part) for part in parts)
        answers = self.server.request(self.now_ns, request)
        assert len(answers) <= 1
        return answers[0] if answers else None

    def talk(self, text: str) -> None:
        talk(lambda request: self.server.request(self.now_ns, request), text)

    def wait(self, nanoseconds: int) -> list[bytes]:
        self.now_ns += nanoseconds
        return self.server.tick(self.now_ns)

    def seed(self, level: Level = Level.PROGRAMMING) -> bytes:
        answer = self.ask(0x27, level)
        assert answer is not None and answer[:2] == bytes([0x67, level]) and len(answer) == 18
        return answer[2:]

    def unlock(self, level: Level = Level.PROGRAMMING) -> None:
        assert self.ask(0x10, Session.PROGRAMMING if level is Level.PROGRAMMING else Session.EXTENDED) is not None
        assert self.ask(0x27, level + 1, self.key.answer(level, self.seed(level))) == bytes([0x67, level + 1])

    def _random_bytes(self, count: int) -> bytes:
        self._drawn += 1
        return self.seeds.pop(0) if self.seeds else self._drawn.to_bytes(count, "big")


def talk(ask: Callable[[bytes], list[bytes]], text: str) -> None:
    """Lines of a request and its one answer, in hexadecimal, `00x7` for seven such bytes.

    An answer may be a code's name, `ok` for any positive one, and `-` for none.
    """
    for line in text.strip().splitlines():
        request, answer = (part.strip() for part in line.split(">"))
        parts = (part.partition("x") for part in request.split())
        asked = b"".join(bytes.fromhex(byte) * int(count or 1) for byte, _, count in parts)
        answers = ask(asked)
        if answer == "ok":
            assert [each[0] for each in answers] == [asked[0] + 0x40], line
        elif answer in Nrc.__members__:
            assert answers == [refused(asked[0], Nrc[answer])], line
        else:
            assert answers == ([] if answer == "-" else [bytes.fromhex(answer)]), line


def refused(service: int, code: Nrc) -> bytes:
    return bytes([0x7F, service, code])
