"""The requests to an ECU through udsoncan's client. A request that gets no answer is repeated."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

from can_bridge.flashing.state import Level
from can_bridge.tester.messages import AccessError, NoAnswerError, RefusedError, in_good_state
from can_bridge.uds.fault_memory import SNAPSHOT_FORMATS
from can_bridge.uds.services import Did, Nrc, Routine, Session
from contract.errors import FlashError

if TYPE_CHECKING:
    from udsoncan.client import Client

KeyOf = Callable[[Level, bytes], bytes]
"""A function that returns the key for a seed of a security level."""

P2_S: Final = 1.0
"""Longest wait in s for the first answer to a request: the ECU's 50 ms, and the delay of adapters and a busy bus."""
P2_EXTENDED_S: Final = 6.0
"""Longest wait in s for the next answer after a response-pending."""
LONGEST_PENDING_S: Final = 60.0
"""Longest time in s for which an ECU may send only response-pending or busy answers, before the request fails."""
TIMES: Final = 5
"""Largest number of attempts at a request that gets no answer."""
READ_TIMES: Final = 25
"""Largest number of attempts to read an identifier: the store's report takes 150 classic frames, any of which may be
lost. There are only `TIMES` attempts if the ECU has never answered, because it is then probably absent."""
BUSY_WAIT_S: Final = 0.1
DELAY_S: Final = 15.0
"""Longest wait in s while the ECU accepts no key after wrong keys; it exceeds the ECU's delay of 10 s."""
_NO_ACCESS: Final[Mapping[int, str]] = {
    Nrc.INVALID_KEY: "the ECU refused the key for {level}: it must be the ECU's key; name the key's file with --access",
    Nrc.EXCEEDED_ATTEMPTS: "the ECU refused the key, and accepts no key for 10 s after several wrong keys; wait, and "
    "name the ECU's key file with --access",
    Nrc.DELAY_NOT_EXPIRED: f"the ECU accepts no key after wrong keys, even after {DELAY_S:g} s; wait, and try again",
}


class Asking:
    """A tester's connection to an ECU; `unanswered` is the number of requests repeated because no answer came."""

    def __init__(
        self, client: "Client", *, key: KeyOf | None, clock: Callable[[], float], sleep: Callable[[float], None]
    ) -> None:
        """Configure the client; its connection must be open. `key` is needed to unlock a level. Times are in s."""
        self._client, self.clock, self.sleep = client, clock, sleep
        self._began = clock()
        self.unanswered = 0
        self._has_answered = False
        client.set_configs(_settings(key, self._pending))

    def session(self, session: Session) -> None:
        """Begin a session; raises NotNowError if the vehicle's state forbids it."""
        self._in_good_state(f"begin the {session.name.lower()} session", lambda: self._client.change_session(session))

    def read(self, did: Did, *, times: int = READ_TIMES) -> bytes:
        number = int(did)
        found = self._ask(f"read {did.name.lower()}", lambda: self._client.read_data_by_identifier(number), times=times)
        return bytes(found.service_data.values[number])

    def number(self, did: Did, size: int) -> int:
        """Read a number of `size` bytes; raises FlashError if the ECU states another length."""
        raw = self.read(did)
        if len(raw) != size:
            raise FlashError(
                f"the ECU's {did.name.lower()} has {len(raw)} bytes, must have {size}: the ECU has another version "
                "of stillwake, or is another ECU"
            )
        return int.from_bytes(raw, "big")

    def write(self, did: Did, value: bytes) -> None:
        self._ask(f"write {did.name.lower()}", lambda: self._client.write_data_by_identifier(int(did), value))

    def routine(self, routine: Routine, option: bytes = b"") -> bytes:
        """Start a routine and return its status record. Raises NotNowError if the vehicle's state forbids it."""
        step = f"run {routine.name.lower()}"
        found = self._in_good_state(step, lambda: self._client.start_routine(int(routine), option or None))
        return bytes(found.service_data.routine_status_record)

    def unlock(self, level: Level) -> None:
        """Unlock a level; wait up to `DELAY_S` while the ECU accepts no key. Raises AccessError after wrong keys."""
        step = f"unlock {level.name.lower()}"
        until = self.clock() + DELAY_S
        had_late_answer = False
        while True:
            unanswered = self.unanswered
            try:
                # If the answer to the key is lost, another seed is requested; this seed is zero if the key was valid.
                self._ask(step, lambda: self._client.unlock_security_access(int(level)))
                return
            except RefusedError as refused:
                if refused.code == Nrc.INVALID_KEY and self.unanswered > unanswered and not had_late_answer:
                    # The key may have been computed from the late answer to an earlier request.
                    had_late_answer = True
                    continue
                if refused.code not in _NO_ACCESS:
                    raise
                if refused.code != Nrc.DELAY_NOT_EXPIRED or self.clock() >= until:
                    raise AccessError(_NO_ACCESS[refused.code].format(level=level.name.lower())) from refused
            # The delay is longer than S3. This message, which the ECU does not answer, keeps the session open.
            with self._client.suppress_positive_response:
                self._client.tester_present()
            self.sleep(1.0)

    def download(self, offset: int, length: int) -> int:
        """Announce `length` bytes of the image from byte `offset` on; return the longest transfer request's length."""
        from udsoncan import MemoryLocation

        location = MemoryLocation(offset, length, address_format=32, memorysize_format=32)
        found = self._ask("take the image", lambda: self._client.request_download(location))
        return int(found.service_data.max_length)

    def transfer(self, counter: int, data: bytes) -> None:
        """Send a block of the image, and repeat it if no answer comes; the ECU writes a repeated block only once."""
        self._ask("take a block of the image", lambda: self._client.transfer_data(counter, data))

    def exit(self) -> None:
        self._ask("end the transfer", self._client.request_transfer_exit)

    def faults(self, report: str, *args: int, **others: int) -> Any:
        """Return the codes in a report of the fault memory. `report` names the client's method for this report."""
        return self._ask("report its faults", lambda: getattr(self._client, report)(*args, **others)).service_data.dtcs

    def clear_faults(self) -> None:
        """Clear the ECU's fault memory; raises NotNowError while a jet may run."""
        with in_good_state("clear its faults", "its jets are enabled"):
            self._ask("clear its faults", self._client.clear_dtc)

    def quieten(self) -> None:
        """Switch off the detection of faults and the control loop's messages, if the ECU permits this."""
        for call in (lambda: self._client.control_dtc_setting(2), lambda: self._client.communication_control(1, 1)):
            with suppress(RefusedError, NoAnswerError):
                self._ask("stop sending", call, times=2)

    def reset(self) -> None:
        """Request a hard reset, once; raises NotNowError if the reset would interrupt active control."""
        self._in_good_state("reset", lambda: self._client.ecu_reset(1), times=1)

    def wait_until_there(self, seconds: float, step: str) -> Session:
        """Wait for an ECU that is starting, and return its session. Raises NoAnswerError after `seconds`."""
        until = self.clock() + seconds
        while True:
            try:
                return Session(self.read(Did.ACTIVE_SESSION, times=1)[0])
            except (NoAnswerError, IndexError, ValueError):
                if self.clock() >= until:
                    raise NoAnswerError(step) from None
            self.sleep(BUSY_WAIT_S)

    def _in_good_state(self, step: str, call: Callable[[], Any], *, times: int = TIMES) -> Any:
        with in_good_state(step, "its jets are enabled or the vehicle asks for control"):
            return self._ask(step, call, times=times)

    def _ask(self, step: str, call: Callable[[], Any], *, times: int = TIMES) -> Any:
        """Return the ECU's answer. Raises RefusedError for a negative answer; NoAnswerError after `times` attempts."""
        from udsoncan import exceptions

        sent = 0
        self._began = self.clock()
        while True:
            sent += 1
            try:
                answer = call()
                self._has_answered = True
                return answer
            except exceptions.NegativeResponseException as error:
                self._has_answered = True
                code = int(error.response.code or 0)
                if code != Nrc.BUSY_REPEAT_REQUEST or self.clock() - self._began > LONGEST_PENDING_S:
                    raise RefusedError(step, code) from None
                sent -= 1
                self.sleep(BUSY_WAIT_S)
            except (
                exceptions.TimeoutException,
                exceptions.InvalidResponseException,
                exceptions.UnexpectedResponseException,
            ):
                if sent >= (times if self._has_answered else min(times, TIMES)):
                    raise NoAnswerError(step, was_there=self._has_answered) from None
                self.unanswered += 1

    def _pending(self) -> None:
        from udsoncan.exceptions import TimeoutException

        if self.clock() - self._began > LONGEST_PENDING_S:
            raise TimeoutException


def _settings(key: KeyOf | None, pending: Callable[[], None]) -> Any:
    from udsoncan import DidCodec

    class AsItIs(DidCodec):
        def encode(self, *did_value: Any) -> bytes:
            return bytes(did_value[0])

        def decode(self, did_payload: bytes) -> bytes:
            return did_payload

        def __len__(self) -> int:
            raise DidCodec.ReadAllRemainingData

    def algorithm(level: int, seed: bytes) -> bytes:
        if key is None:
            raise AccessError("the ECU asks for a key; name the ECU's key file with --access")
        return key(Level(level), seed)

    return {
        "data_identifiers": {"default": AsItIs()} | {int(did): form for did, form in SNAPSHOT_FORMATS.items()},
        "security_algo": algorithm,
        "nrc78_callback": pending,
        # With a timeout, the client would measure the time of a whole request with the real clock.
        "request_timeout": None,
        "p2_timeout": P2_S,
        "p2_star_timeout": P2_EXTENDED_S,
        "use_server_timing": False,
        "standard_version": 2020,
    }
