"""The failure of a memory that a store stands in."""

from contract.errors import BusError


class MediumError(BusError):
    """The memory failed at `address`."""

    def __init__(self, message: str, address: int) -> None:
        super().__init__(message)
        self.address = address
