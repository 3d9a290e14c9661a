"""The thread that serves a tester, so that neither a slow disk nor a long check comes into a control period.

It takes the frames of diagnosis, does a piece of work and sends what is due, at once while there is work, else when a
frame comes. A reset boots here too; the control goes on with what was booted from its next period on.
"""

from collections.abc import Callable, Sequence
from threading import Event, Thread
from typing import Final, Self

from can_bridge.wire.frame import Frame
from ecu.flashable.flashable_ecu import FlashableEcu
from ecu.flashable.links import MOST_FRAMES
from ecu.real_time.inbox import Inbox
from ecu.real_time.privileges import step_back

ROOM: Final = 1024
"""Frames that wait: seven longest requests of CAN FD. In a flood the oldest give way."""
PAUSE_S: Final = 0.05
"""Without a frame between two looks: what time alone ends is seen so late."""
SENDING_S: Final = 0.001
"""Between two portions of an answer of many frames."""


class DiagnosisThread:
    """Works while its `with` block does.

    Args:
        ecu: whose diagnosis it serves; its control is another thread's.
        failed: called with the error that ends the thread before its time, if one does.
    """

    def __init__(
        self,
        ecu: FlashableEcu,
        send: Callable[[Sequence[Frame]], object],
        *,
        now_ns: Callable[[], int],
        failed: Callable[[BaseException], None],
    ) -> None:
        self._ecu, self._send, self._now_ns, self._failed = ecu, send, now_ns, failed
        self._inbox = Inbox(lambda frame: now_ns(), room=ROOM)
        self._wakes, self._stop = Event(), Event()
        self._thread = Thread(target=self._run, name="diagnosis", daemon=True)

    def put(self, frame: Frame) -> None:
        """Leave a frame; called by the thread that reads the bus."""
        self._inbox.put(frame)
        self._wakes.set()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._wakes.set()
        self._thread.join()

    def _run(self) -> None:
        step_back()
        try:
            while not self._stop.is_set():
                self._wakes.wait(SENDING_S if self._ecu.is_busy else PAUSE_S)
                self._wakes.clear()
                frames = self._inbox.take()
                for first in range(0, max(1, len(frames)), MOST_FRAMES):
                    self._send(self._ecu.service(self._now_ns(), frames[first : first + MOST_FRAMES]))
        except BaseException as error:  # noqa: BLE001 - an error that ends a thread is lost unless it is reported
            self._failed(error)
