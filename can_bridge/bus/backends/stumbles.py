"""Errors that a python-can backend raises in a reception: on what it was sent, or because the bus is gone."""

from typing import Final

import can

from can_bridge.bus.backends.opening import one_line
from contract.errors import BusError

GARBAGE_LIMIT: Final = 1000
"""Receptions in a row, without an idle moment or a good frame between them, at which a backend of python-can stumbled,
after which the bus counts as failed: a dead one that raises on every call would otherwise look like endless noise.
Our own backends say what they refuse, and are believed for ever."""


class Stumbles:
    """Those in a row, of one bus."""

    def __init__(self) -> None:
        self._in_a_row = 0

    def over(self) -> None:
        """A reception went well, or nothing came."""
        self._in_a_row = 0

    def met(self, error: Exception) -> None:
        """One reception raised this.

        Raises:
            BusError: if the bus failed, or yields nothing but garbage.
        """
        # Backends wrap what went wrong. A fault of the system or of python-can itself ends the bus; anything else is
        # an error of their parser on what it was sent.
        if isinstance(error.__cause__ or error, OSError | can.CanError):
            raise BusError(f"CAN bus failed: {one_line(error)}") from error
        self._in_a_row += 1
        if self._in_a_row > GARBAGE_LIMIT:
            raise BusError(f"CAN bus failed: {GARBAGE_LIMIT} unreadable receptions in a row, last: {error}") from error
