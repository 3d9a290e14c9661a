"""Captured frames in candump's format, which can-utils, python-can, cantools and any editor can read.

Times are absolute, in microseconds. `python -m can.logconvert frames.log frames.blf` writes another format.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import can

from can_bridge.bus.conversion import to_message
from can_bridge.wire.frame import Frame
from contract.atomic import replacing


@contextmanager
def recording(path: Path) -> Iterator[Callable[[Frame], None]]:
    """Yield a function that appends a frame to the log. The file is created only if the `with` block ends without an
    error.

    Frames must come in the order of their timestamps: the writer stamps a frame that is earlier than the previous frame
    with the previous frame's time. Raises StillwakeError if the file cannot be written.
    """
    with replacing(path) as temporary, can.CanutilsLogWriter(temporary) as writer:
        yield lambda frame: writer.on_message_received(to_message(frame))
