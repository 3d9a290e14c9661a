"""The ECU's side of UDS (ISO 14229-1): a server that receives requests and returns answers; the time is an argument.

Every request is checked in the order of the standard's figures: service known, allowed in this session, valid length,
sub-function known and allowed in this session, level unlocked, valid sequence. Then the ECU may refuse the request for
reasons of its own. One request is processed at a time, in parts, one part in each call of `tick`. The method for a
service has the service's name.
"""

from collections.abc import Callable, Mapping
from typing import Final

from can_bridge.flashing.backing import Long
from can_bridge.flashing.state import Level
from can_bridge.uds import services
from can_bridge.uds.ecu_services import EcuServices
from can_bridge.uds.fault_memory import CODE_BYTES, LENGTHS, FaultMemory, FaultReport, cleared, report
from can_bridge.uds.security import ANSWER_LENGTH, AccessKey, SecurityAccess
from can_bridge.uds.services import MAX_BLOCK, SERVICES, Did, Nrc, Permission, Refused, Routine, Service, Session
from can_bridge.uds.under_way import Download, Job, negative

MAX_DIDS: Final = 16
"""Largest number of identifiers that one request may read."""
_S3_NS: Final = services.S3_MS * 1_000_000
_TIMING: Final = services.P2_MS.to_bytes(2, "big") + (services.P2_EXTENDED_MS // 10).to_bytes(2, "big")
"""P2 in ms and P2* in units of 10 ms, as in the answer to DiagnosticSessionControl."""
_SUPPRESS: Final = 0x80
_DISABLE_SENDING: Final = 1
_NORMAL: Final = frozenset({0x01, 0x03})
"""Kinds of communication that include JetCommand and EcuStatus: normal messages, with or without network management."""
_FAULTS_ON: Final = 1
_FORMATS: Final = b"\x00\x44"
"""Format bytes of a download request: neither compressed nor encrypted; four bytes of length and four of address."""
_TWO_BYTES: Final = 0x20
"""Format byte of the block length in the answer to a download request."""
_SUB_FUNCTIONS: Final[Mapping[int, frozenset[int]]] = {
    Service.SESSION: frozenset(Session),
    Service.RESET: frozenset({1}),  # hard reset
    Service.REPORT_FAULTS: frozenset(FaultReport),
    # The number of a level requests the level's seed; the next number sends the answer to the seed.
    Service.SECURITY: frozenset(level + is_answer for level in Level for is_answer in (0, 1)),
    Service.COMMUNICATION: frozenset({0, _DISABLE_SENDING}),
    Service.ROUTINE: frozenset({1}),  # start
    Service.TESTER_PRESENT: frozenset({0}),
    Service.FAULT_SETTING: frozenset({_FAULTS_ON, 2}),
}
"""Sub-functions of the services whose first byte is a sub-function, without the suppress-positive-response bit."""
_DIDS: Final[frozenset[int]] = frozenset(Did)


class UdsServer:
    """A server after power-on. It accepts any bytes, and raises only the exceptions of `diagnostics`.

    Args:
        random_bytes: returns the given number of unpredictable bytes, for seeds.

    Attributes:
        is_silent: whether a tester has switched off JetCommand and EcuStatus; only possible while no jet can run.
    """

    def __init__(
        self,
        diagnostics: EcuServices,
        key: AccessKey,
        random_bytes: Callable[[int], bytes],
        faults: FaultMemory,
    ) -> None:
        self._diagnostics, self._faults = diagnostics, faults
        self.is_silent = False
        self._security = SecurityAccess(key, random_bytes, diagnostics)
        self.session = Session.DEFAULT
        self._heard_ns = 0
        self._transfer: Download | None = None
        self._job: Job | None = None
        self._reset_is_due = False
        self._now_ns: int | None = None

    @property
    def unlocked(self) -> Level | None:
        return self._security.unlocked

    @property
    def is_busy(self) -> bool:
        """Whether a request or a reset is in progress; `tick` continues it."""
        return self._job is not None or self._reset_is_due

    @property
    def is_writing(self) -> bool:
        return self._job is not None and self._job.service == Service.TRANSFER

    def look(self, now_ns: int, *, in_transit: bool) -> None:
        """End the session if there was no request for the time S3. Call this method before each reading of the bus. The
        session continues while a request is processed, or a message is `in_transit` in either direction (ISO 14229-2).
        """
        now_ns = self._at(now_ns)
        if in_transit:
            self._heard_ns = now_ns
        self._end_silent_session(now_ns)

    def request(
        self, now_ns: int, payload: bytes, *, is_functional: bool = False, is_occupied: bool = False
    ) -> list[bytes]:
        """Process a complete request and return its answers: none if the answer is suppressed or not ready. If
        `is_occupied`, a long answer to an earlier request is not yet sent completely; this request is then refused as
        busy. A functional request addresses every ECU."""
        now_ns = self._at(now_ns)
        if not payload:
            return []
        self._end_silent_session(now_ns)
        if self.is_busy or is_occupied:
            if payload == bytes([Service.TESTER_PRESENT, _SUPPRESS]):
                return []
            return [negative(payload[0], Nrc.BUSY_REPEAT_REQUEST)]
        is_quiet = len(payload) > 1 and payload[0] in _SUB_FUNCTIONS and bool(payload[1] & _SUPPRESS)
        passed_over = services.UNSENT_TO_ALL if is_functional else ()
        self._job = Job(now_ns, payload[0], self._answer(payload), is_quiet=is_quiet, passed_over=passed_over)
        return self._go_on(now_ns)

    def tick(self, now_ns: int) -> list[bytes]:
        """Execute the next part of a request, or an answered reset. Call this at least every 20 ms while `is_busy`."""
        now_ns = self._at(now_ns)
        if self._reset_is_due:
            self._reset_is_due = False
            self._diagnostics.reset()
        self._end_silent_session(now_ns)
        return self._go_on(now_ns)

    def _at(self, now_ns: int) -> int:
        """Return the time, or the latest time so far if the clock went back."""
        if self._now_ns is None:
            self._security.power_on(now_ns)
        self._now_ns = now_ns if self._now_ns is None else max(now_ns, self._now_ns)
        return self._now_ns

    def _go_on(self, now_ns: int) -> list[bytes]:
        job, self._job = self._job, None
        if job is None:
            return []
        answers = job.go_on(now_ns)
        if job.is_done:
            self._heard_ns = now_ns
        else:
            self._job = job
        return answers

    def _end_silent_session(self, now_ns: int) -> None:
        if self._job is None and self.session is not Session.DEFAULT and now_ns - self._heard_ns >= _S3_NS:
            self._change_session(now_ns, Session.DEFAULT)

    def _change_session(self, now_ns: int, session: Session) -> None:
        if self.session is not Session.DEFAULT:
            self._diagnostics.leave()
        if session is Session.DEFAULT:
            self.is_silent, self._faults.is_on = False, True
        self._security.lock()
        self._transfer = None
        self.session, self._heard_ns = session, now_ns

    def _answer(self, payload: bytes) -> Long[bytes]:
        """Return the positive response's bytes after the first byte."""
        service, body = payload[0], payload[1:]
        permission = SERVICES.get(service)
        if permission is None:
            raise Refused(Nrc.SERVICE_NOT_SUPPORTED)
        if self.session not in permission.sessions:
            raise Refused(Nrc.SERVICE_NOT_IN_SESSION)
        _check_length(len(payload) <= services.MAX_REQUEST)
        if service in _SUB_FUNCTIONS:
            _check_length(len(body) >= 1)
            body = bytes([body[0] & ~_SUPPRESS]) + body[1:]
            if body[0] not in _SUB_FUNCTIONS[service]:
                raise Refused(Nrc.SUB_FUNCTION_NOT_SUPPORTED)
        handle: Callable[[bytes], bytes | Long[bytes]] = getattr(self, f"_on_{Service(service).name.lower()}")
        answer = handle(body)
        return answer if isinstance(answer, bytes) else (yield from answer)

    def _on_session(self, body: bytes) -> bytes:
        _check_length(len(body) == 1)
        session = Session(body[0])
        self._diagnostics.enter(session)
        self._change_session(self._now(), session)
        return body + _TIMING

    def _on_reset(self, body: bytes) -> bytes:
        _check_length(len(body) == 1)
        self._diagnostics.before_reset()
        self._reset_is_due = True
        return body

    def _on_clear_faults(self, body: bytes) -> bytes:
        _check_length(len(body) == CODE_BYTES)
        self._faults.clear(cleared(int.from_bytes(body, "big")))
        return b""

    def _on_report_faults(self, body: bytes) -> bytes:
        kind = FaultReport(body[0])
        _check_length(len(body) == 1 + LENGTHS[kind])
        return body[:1] + report(self._faults, kind, body[1:])

    def _on_communication(self, body: bytes) -> bytes:
        _check_length(len(body) == 2)
        if body[1] not in _NORMAL:
            raise Refused(Nrc.OUT_OF_RANGE)
        if body[0] == _DISABLE_SENDING:
            # Switching off the messages has the same conditions as a reset, so that no control is interrupted.
            self._diagnostics.before_reset()
        self.is_silent = body[0] == _DISABLE_SENDING
        return body[:1]

    def _on_fault_setting(self, body: bytes) -> bytes:
        _check_length(len(body) == 1)
        self._faults.is_on = body[0] == _FAULTS_ON
        return body

    def _on_tester_present(self, body: bytes) -> bytes:
        _check_length(len(body) == 1)
        return body

    def _on_read(self, body: bytes) -> bytes:
        _check_length(len(body) > 0 and len(body) % 2 == 0 and len(body) <= 2 * MAX_DIDS)
        answer = b""
        for number in (body[i : i + 2] for i in range(0, len(body), 2)):
            try:
                answer += number + self._value(int.from_bytes(number, "big"))
            except Refused as refusal:
                # The standard leaves an unknown identifier out of the answer if another identifier is known.
                if refusal.code is not Nrc.OUT_OF_RANGE:
                    raise
        if not answer:
            raise Refused(Nrc.OUT_OF_RANGE)
        if 1 + len(answer) > (services.LONGEST_ANSWER if len(body) > 2 else services.MAX_REQUEST):
            raise Refused(Nrc.RESPONSE_TOO_LONG)
        return answer

    def _value(self, number: int) -> bytes:
        if number not in _DIDS:
            raise Refused(Nrc.OUT_OF_RANGE)
        if number == Did.ACTIVE_SESSION:
            return bytes([self.session])
        return self._diagnostics.read(Did(number))

    def _on_security(self, body: bytes) -> bytes:
        level, is_answer = Level(body[0] - (body[0] + 1) % 2), body[0] % 2 == 0
        if self.session not in services.LEVELS[level].sessions:
            raise Refused(Nrc.SUB_FUNCTION_NOT_IN_SESSION)
        if not is_answer:
            _check_length(len(body) == 1)
            return body + self._security.seed(self._now(), level)
        _check_length(len(body) == 1 + ANSWER_LENGTH)
        self._security.unlock(self._now(), level, body[1:])
        return body[:1]

    def _on_write(self, body: bytes) -> bytes:
        _check_length(len(body) > 2)
        number, value = int.from_bytes(body[:2], "big"), body[2:]
        self._check_permission(services.WRITABLE.get(number), len(value))
        self._diagnostics.write(Did(number), value)
        return body[:2]

    def _on_routine(self, body: bytes) -> Long[bytes]:
        _check_length(len(body) >= 3)
        number, option = int.from_bytes(body[1:3], "big"), body[3:]
        self._check_permission(services.ROUTINES.get(number), len(option))
        routine = Routine(number)
        if routine is Routine.ERASE:
            self._transfer = None
        return body[:3] + (yield from self._diagnostics.routine(routine, option))

    def _on_download(self, body: bytes) -> bytes:
        _check_length(len(body) >= 2)
        if body[:2] != _FORMATS:
            raise Refused(Nrc.OUT_OF_RANGE)
        _check_length(len(body) == 2 + 4 + 4)
        self._check_unlocked(SERVICES[Service.DOWNLOAD])
        offset, length = int.from_bytes(body[2:6], "big"), int.from_bytes(body[6:], "big")
        under_way = self._transfer
        if under_way is None or under_way.is_closed:
            self._diagnostics.download(offset, length)
            self._transfer = Download(offset, length)
        elif (under_way.offset, under_way.length, under_way.missing) != (offset, length, length):
            # Another download was requested, or blocks of this one have come.
            raise Refused(Nrc.CONDITIONS_NOT_CORRECT)
        return bytes([_TWO_BYTES]) + MAX_BLOCK.to_bytes(2, "big")

    def _on_transfer(self, body: bytes) -> Long[bytes]:
        _check_length(1 < len(body) < MAX_BLOCK)
        self._check_unlocked(SERVICES[Service.TRANSFER])
        counter, data = body[0], body[1:]
        if self._transfer is None:
            raise Refused(Nrc.SEQUENCE_ERROR)
        if self._transfer.is_new(counter, data):
            transfer, self._transfer = self._transfer, None
            # If writing fails, the transfer ends, because only a new announcement shows which bytes are stored.
            yield from self._diagnostics.transfer(data)
            transfer.taken(counter, data)
            self._transfer = transfer
        return body[:1]

    def _on_exit(self, body: bytes) -> bytes:
        _check_length(not body)
        self._check_unlocked(SERVICES[Service.EXIT])
        if self._transfer is None or self._transfer.missing:
            raise Refused(Nrc.SEQUENCE_ERROR)
        # The bytes are not checked here: the routine CHECK compares them with the announced hash.
        self._transfer.is_closed = True
        return b""

    def _check_permission(self, permission: Permission | None, length: int) -> None:
        if permission is None or self.session not in permission.sessions:
            raise Refused(Nrc.OUT_OF_RANGE)
        self._check_unlocked(permission)
        _check_length(permission.length in (None, length))

    def _check_unlocked(self, permission: Permission) -> None:
        if permission.level is not None and self.unlocked is not permission.level:
            raise Refused(Nrc.SECURITY_ACCESS_DENIED)

    def _now(self) -> int:
        return self._now_ns or 0


def _check_length(is_right: bool) -> None:
    if not is_right:
        raise Refused(Nrc.INCORRECT_LENGTH)
