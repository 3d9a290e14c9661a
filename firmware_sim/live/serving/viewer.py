"""How far one viewer has come: it holds counts and no messages, however long it does not read."""

from firmware_sim.live.loop.messages import Message
from firmware_sim.live.serving.hub import STREAMS, Hub


class Viewer:
    """A viewer of a hub, from its beginning.

    Args:
        hub: what it looks at.
    """

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._counts = dict.fromkeys(STREAMS, 0)

    def take(self, stream: str) -> Message | bytes | None:
        """What this viewer has not had of one of `STREAMS`; None if nothing.

        Of latest values the newest. Of the others the oldest `MOST_ROWS` that the hub still has.
        """
        message, self._counts[stream] = self._hub.after(stream, self._counts[stream])
        if stream == "hello" and message is not None:
            # A page begins again with it. What was taken of the new run before its `hello` is wanted again.
            self._counts |= dict.fromkeys(STREAMS[STREAMS.index("hello") + 1 :], 0)
        return message
