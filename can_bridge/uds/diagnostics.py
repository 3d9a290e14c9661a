"""What the server of `can_bridge.uds.server` needs of the ECU around it."""

from typing import Protocol

from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Long
from can_bridge.uds.services import Did, Routine, Session


class Diagnostics(Protocol):
    """Every method may raise `Refused` with the negative response code; the server has checked session, security level,
    and lengths where `services` states them."""

    def enter(self, session: Session) -> None:
        """Before a session begins: CONDITIONS_NOT_CORRECT for PROGRAMMING while the jets are enabled or the vehicle
        asks for control."""

    def leave(self) -> None:
        """The session ended, for whatever reason: drop a transfer that is under way (it can be resumed)."""

    def read(self, did: Did) -> bytes:
        """The value of an identifier; OUT_OF_RANGE if it has none."""
        ...

    def write(self, did: Did, value: bytes) -> Long[None]:
        """Write an identifier; OUT_OF_RANGE for a value that is not allowed."""
        ...

    def routine(self, routine: Routine, option: bytes) -> Long[bytes]:
        """Run a routine; returns its status record."""
        ...

    def download(self, offset: int, length: int) -> None:
        """Bytes of the announced image from `offset` on will come, `length` of them."""

    def transfer(self, data: bytes) -> Long[None]:
        """The next bytes."""
        ...

    def exit(self) -> Long[None]:
        """No more bytes come."""
        ...

    def failed_attempts(self, level: Level) -> int:
        """Wrong keys in a row, over resets."""
        ...

    def keep_failed_attempts(self, level: Level, count: int) -> None:
        """Keep them before the answer goes out."""

    def before_reset(self) -> None:
        """Before a reset, and before the ECU falls silent: CONDITIONS_NOT_CORRECT while that would stop a control that
        runs; a session may have begun before it."""

    def reset(self) -> None:
        """A reset was asked for and has been answered."""
