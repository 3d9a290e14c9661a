"""How the memories of the tests fail."""

from can_bridge.flashing.backing import MediumError


class UnreadableError(MediumError):
    """What a cut left half written: on a chip, a bus fault."""


class PowerCut(BaseException):
    """Raised by a memory that plays a loss of supply; what was under way is torn, and no handler may go on."""
