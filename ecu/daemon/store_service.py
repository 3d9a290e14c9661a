"""The process of an ECU with a store of releases. It has the control loop, and a thread that serves a tester, so that
slow disks and long checks do not delay a control period.

The thread processes the frames of diagnosis, does one part of a long operation, and sends the frames that are due.
During a long operation it repeats this every ms. After a reset it boots a release, which the control loop then runs.
"""

import secrets
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from threading import Event, Thread
from typing import Final, Self

from can_bridge.flashing.folder_backing import FolderBacking
from can_bridge.uds.security import AccessKey
from can_bridge.wire.frame import Frame
from contract.config.tree import Config
from contract.controller.interface import Controller
from contract.release.checks import Bundle
from contract.runtime.onnx_session import OnnxController
from ecu.daemon.connection import Connection
from ecu.daemon.process import WARM_UP_STEPS, ProcessOptions, authentication_of, check, reporter_of, run
from ecu.daemon.reporter import Counters
from ecu.flashable.ecu_folder import EcuFolder, held
from ecu.flashable.equipment import Equipment
from ecu.flashable.flashable_ecu import FlashableEcu
from ecu.flashable.links import MOST_FRAMES
from ecu.real_time import clock
from ecu.real_time.inbox import Inbox
from ecu.real_time.privileges import step_back
from ecu.real_time.stage_times import PlanTimes, TimedController

_ROOM: Final = 1024
"""Largest number of waiting frames: enough for seven longest requests on CAN FD. Another frame replaces the oldest."""
PAUSE_S: Final = 0.05
"""Largest time in s between two calls of `service` if no frame arrives, and so the longest delay of a timeout."""
SENDING_S: Final = 0.001
"""Time in s between two calls of `service` during a long operation, a long answer, or a tool's measurement."""


class DiagnosisThread:
    """A thread that serves the tester while its `with` block runs. It calls `failed` with an error that ends it."""

    def __init__(
        self, ecu: FlashableEcu, send: Callable[[Sequence[Frame]], object], failed: Callable[[BaseException], None]
    ) -> None:
        self._ecu, self._send, self._failed = ecu, send, failed
        self._inbox = Inbox(lambda frame: clock.now_ns(), room=_ROOM)
        self._wakes, self._stop = Event(), Event()
        self._thread = Thread(target=self._run, name="diagnosis", daemon=True)

    def put(self, frame: Frame) -> None:
        """Add a frame; the thread that reads the bus calls this."""
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
                self._wakes.wait(SENDING_S if self._ecu.is_busy or self._ecu.is_measuring else PAUSE_S)
                self._wakes.clear()
                frames = self._inbox.take()
                for first in range(0, max(1, len(frames)), MOST_FRAMES):
                    self._send(self._ecu.service(clock.now_ns(), frames[first : first + MOST_FRAMES]))
        except BaseException as error:  # noqa: BLE001 - an error that ends a thread is lost unless it is reported
            self._failed(error)


SWITCH_INTERVAL_S: Final = 0.0005
"""Longest time in s for which another thread can delay the waking of the control loop; Python's default is 5 ms."""
NO_RELEASE: Final = "none"


def serve_store(
    folder: EcuFolder,
    access: AccessKey,
    config: Config,
    options: ProcessOptions,
    *,
    software: str,
    is_stopped: Callable[[], bool],
    write: Callable[[str], object],
) -> Counters:
    """Run the ECU like `ecu.daemon.process.serve`. Also raises StillwakeError if another process runs this ECU, or if a
    reset within the process failed; after a failed reset, a new process has to boot the ECU."""
    check(config, options)
    times = PlanTimes()

    def controller_of(release: Bundle) -> Controller:
        controller = OnnxController.of(release)
        controller.warm_up(WARM_UP_STEPS)
        return TimedController(controller, clock.now_ns, times)

    with ExitStack() as stack:
        stack.enter_context(held(folder.folder))
        stack.callback(sys.setswitchinterval, sys.getswitchinterval())
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        freshness, authentication = authentication_of(config, options)
        reporter = reporter_of(config, options, freshness, write, NO_RELEASE)

        def log(event: str, line: str, **fields: str | int | float) -> None:
            if event == "no_release":
                reporter.bundle = NO_RELEASE
            elif "digest" in fields:
                reporter.bundle = f"{fields['release']} {str(fields['digest'])[:12]}"
            reporter.tell(event, line, **fields)

        equipment = Equipment(
            root=folder.root,
            access=access,
            random_bytes=secrets.token_bytes,
            hardware=folder.hardware,
            serial=folder.serial,
            software=software,
            controller_of=controller_of,
            log=log,
        )
        ecu = FlashableEcu(FolderBacking(folder.folder), config, equipment, authentication=authentication)
        connections: list[Connection] = []
        fatal: list[BaseException] = []

        def failed(error: BaseException) -> None:
            goes_on = "control continues"
            if ecu.needs_reset:
                # No thread serves the tester any more, and an update ends only with a reset, so the process ends.
                goes_on = "so the process ends"
                fatal.append(error)
            log("diagnosis_ended", f"diagnosis ended, {goes_on}: {type(error).__name__}: {error}")

        diagnosis = DiagnosisThread(ecu, lambda frames: [one.send(frames) for one in connections], failed)

        @contextmanager
        def beside(connection: Connection) -> Iterator[None]:
            connections.append(connection)
            with diagnosis:
                yield

        counters = run(
            ecu,
            times,
            reporter,
            config,
            options,
            is_stopped=lambda: bool(fatal) or is_stopped(),
            line=f"runs ECU {folder.serial} ({folder.hardware}) from {folder.folder}, release {reporter.bundle},",
            fields={"serial": folder.serial, "hardware": folder.hardware, "release": reporter.bundle},
            hears=dict.fromkeys(config.bus.diagnosis.heard, diagnosis.put),
            beside=beside,
        )
    if fatal:
        raise fatal[0]
    return counters
