"""Captured frames in a file that python-can, candump, CANoe or a plain editor can read.

The ending chooses the format: `.log` (candump, times absolute, in microseconds), `.asc` and `.blf` (Vector, times
relative to the first frame, stamped with the date of writing). Only `.log` of equal runs is equal byte for byte.
python-can's CSV is not offered: it loses whether a frame was CAN FD.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import can

from can_bridge.bus.python_can import to_message
from can_bridge.wire.frame import Frame
from contract.atomic import replacing
from contract.errors import StillwakeError

_Writer = can.ASCWriter | can.BLFWriter | can.CanutilsLogWriter

_WRITERS: Final[Mapping[str, Callable[[Path], _Writer]]] = {
    ".log": can.CanutilsLogWriter,
    ".asc": can.ASCWriter,
    ".blf": can.BLFWriter,
}


@contextmanager
def recording(path: Path) -> Iterator[Callable[[Frame], None]]:
    """Yield a function that appends a frame; the file appears when the block succeeds, and not otherwise.

    Frames must come in the order of their timestamps: the writers stamp an earlier one with the time before it.

    Raises:
        StillwakeError: for another ending, or if the place cannot be written.
    """
    writer_of = _WRITERS.get(path.suffix)
    if writer_of is None:
        raise StillwakeError(f"frame log {path}: name must end in {', '.join(_WRITERS)}")
    with replacing(path) as temporary:
        writer = writer_of(temporary)
        try:
            yield lambda frame: writer.on_message_received(to_message(frame))
        finally:
            writer.stop()
