"""Recording: every message of a bus, in the order it came, until something says stop."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import can

POLL_S: Final = 0.1
"""How long one reception may wait, and with it how long stopping may take."""


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """What was written.

    Attributes:
        frames: of any kind.
        not_kept: what the format does not keep, in words, and how often.
    """

    frames: int = 0
    not_kept: Counter[str] = field(default_factory=Counter)


def record(
    receive: Callable[[float], can.Message | None],
    append: Callable[[can.Message], None],
    *,
    loss_of: Callable[[can.Message], str],
    is_over: Callable[[int], bool],
    progress: Callable[[int], None] = lambda frames: None,
) -> Recorded:
    """Move messages from a bus to a file until it is over.

    Args:
        receive: the next message, or None after waiting for so many seconds.
        append: to the file.
        loss_of: what the file will not keep of a message; empty for nothing.
        is_over: asked before each reception with the number of frames so far.
        progress: told that number after each reception.
    """
    frames = 0
    not_kept: Counter[str] = Counter()
    while not is_over(frames):
        message = receive(POLL_S)
        if message is not None:
            append(message)
            frames += 1
            if loss := loss_of(message):
                not_kept[loss] += 1
        progress(frames)
    return Recorded(frames=frames, not_kept=not_kept)
