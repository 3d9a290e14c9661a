"""udsoncan's connection to an ECU without a bus between: for benches and proofs in virtual time."""

from typing import Self

from udsoncan.connections import BaseConnection

from can_bridge.tester.transport import silence


class DirectConnection(BaseConnection):
    """A connection that is always open; a subclass sends a request and waits for an answer."""

    def __init__(self) -> None:
        super().__init__()
        silence()

    def open(self) -> Self:
        """Nothing to be opened: the ECU is there."""
        return self

    def close(self) -> None:
        """Nothing to be closed."""

    def is_open(self) -> bool:
        """Always."""
        return True
