"""What a flash memory is to whoever stores something in it.

Words of 32 bytes are programmed once between two erasures of their sector, as on controllers whose flash has an
error-correcting code a word (STM32H7: RM0433, section 4.3.9). Reading a word whose programming was cut short may fail.
"""

from typing import Final, Protocol

from can_bridge.flashing.medium import MediumError

WORD: Final = 32
"""Bytes that are programmed at once."""
ERASED: Final = b"\xff" * WORD


class UnreadableError(MediumError):
    """A word whose error-correcting code does not fit it: on a chip, a bus fault."""


class WornOutError(MediumError):
    """A sector that can no longer be erased or programmed."""


class PowerCut(BaseException):
    """Raised by a memory that plays a loss of supply; what was under way is torn, and no handler may go on."""


class Medium(Protocol):
    """A flash memory of equal sectors."""

    @property
    def sectors(self) -> int:
        """How many it has."""
        ...

    @property
    def sector_size(self) -> int:
        """Bytes of each."""
        ...

    def read(self, address: int, length: int) -> bytes:
        """Raises UnreadableError if a word in it is torn."""
        ...

    def program(self, address: int, data: bytes) -> None:
        """Program erased words, in order of their addresses; both arguments are multiples of `WORD`.

        Raises:
            WornOutError: the sector is bad.
            MediumError: a word was programmed before.
        """
        ...

    def erase(self, sector: int) -> None:
        """All its words to ones; raises WornOutError if the sector is bad."""
        ...
