"""What a flash memory is to whoever stores something in it.

Words of 32 bytes are programmed once between two erasures of their sector, as on controllers whose flash has an
error-correcting code a word (STM32H7: RM0433, section 4.3.9). Reading a word whose programming was cut short may fail.
"""

from typing import Final

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
