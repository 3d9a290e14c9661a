"""udsoncan's connection to an ECU without a bus between: for benches and proofs in virtual time."""

import logging
from typing import Self

from udsoncan.connections import BaseConnection


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


def silence() -> None:
    """Keep what the libraries log from stderr, where Python prints warnings that no handler takes."""
    for name in ("UdsClient", "Connection", "isotp"):
        logging.getLogger(name).addHandler(logging.NullHandler())
