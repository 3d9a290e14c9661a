"""The end of a connection, whatever has become of what it went through."""

from contextlib import suppress
from types import TracebackType
from typing import Self

import can


class ClosingBus:
    """Holds an open python-can bus. Use as a context manager, or `close` it."""

    def __init__(self, bus: can.BusABC) -> None:
        """Take over an open bus, which is closed together with this object."""
        self._bus = bus

    def close(self) -> None:
        """Disconnect; closing twice does nothing more, nor does closing what has vanished."""
        # An adapter that was unplugged cannot be told; its error would hide the one that ended the work.
        with suppress(can.CanError, OSError):
            self._bus.shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()
