"""The interface from the server in `can_bridge.uds.server` to the ECU."""

from typing import Protocol

from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Long
from can_bridge.uds.services import Did, Routine, Session


class Diagnostics(Protocol):
    """The ECU's services. Every method may raise `Refused` with a negative response code. The server has already
    checked session, security level, and the lengths stated in `services`."""

    def enter(self, session: Session) -> None:
        """Prepare for a session. Raises CONDITIONS_NOT_CORRECT for PROGRAMMING while jets are enabled or control is
        requested."""

    def leave(self) -> None:
        """Interrupt a transfer in progress, because the session ended; the transfer can be resumed."""

    def read(self, did: Did) -> bytes:
        """Return the value of an identifier; raises OUT_OF_RANGE if the identifier has no value."""
        ...

    def write(self, did: Did, value: bytes) -> Long[None]:
        """Write an identifier; raises OUT_OF_RANGE for a value that is not allowed."""
        ...

    def routine(self, routine: Routine, option: bytes) -> Long[bytes]:
        """Run a routine and return its status record."""
        ...

    def download(self, offset: int, length: int) -> None:
        """Expect `length` bytes of the announced image, beginning at byte `offset`."""

    def transfer(self, data: bytes) -> Long[None]:
        """Write the next bytes of the image."""
        ...

    def exit(self) -> Long[None]:
        """End the transfer after its last byte."""
        ...

    def failed_attempts(self, level: Level) -> int:
        """Return the number of consecutive wrong keys; the number survives resets."""
        ...

    def keep_failed_attempts(self, level: Level, count: int) -> None:
        """Store the number of consecutive wrong keys; the server calls this before it answers."""

    def before_reset(self) -> None:
        """Prepare for a reset, or for switching off the messages of the control loop. Raises CONDITIONS_NOT_CORRECT if
        the reset or the missing messages would interrupt active control, which may have begun after the session began.
        """

    def reset(self) -> None:
        """Reset the ECU; called after the request was answered."""
