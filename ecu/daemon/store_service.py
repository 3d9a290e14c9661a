"""An ECU that runs the release in its folder, and can be flashed and calibrated over the same bus.

The control has the main thread, the tester one of its own (`diagnosis_thread`). A reset that a tester asks for boots
within the process: the store is read again, and everything volatile is made again.
"""

import secrets
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from can_bridge.uds.security import AccessKey
from contract.config.tree import Config
from contract.controller.interface import Controller
from contract.release.checks import Bundle
from contract.runtime.onnx_session import OnnxController
from ecu.daemon.connection import Connection
from ecu.daemon.counters import Counters
from ecu.daemon.diagnosis_thread import DiagnosisThread
from ecu.daemon.options import Options, authentication_of
from ecu.daemon.process import Served, check, run
from ecu.daemon.reporter import Reporter
from ecu.daemon.service import WARM_UP_STEPS
from ecu.flashable.ecu_folder import EcuFolder, held
from ecu.flashable.equipment import Equipment
from ecu.flashable.flashable_ecu import FlashableEcu
from ecu.real_time import clock
from ecu.real_time.timed_controller import PlanTimes, TimedController

SWITCH_INTERVAL_S: Final = 0.0005
"""For which a thread may keep the interpreter from the control that has just woken; Python's own is 5 ms."""
NO_RELEASE: Final = "none"

Fields = str | int | float


class Log:
    """Keeps events from before there is a log, and knows what was booted last. `release` is what is booted, in
    words."""

    def __init__(self) -> None:
        self._early: list[tuple[str, str, dict[str, Fields]]] = []
        self._reporter: Reporter | None = None
        self.release = NO_RELEASE

    def tell(self, event: str, line: str, **fields: Fields) -> None:
        """As `Equipment.log`."""
        if event == "no_release":
            self.release = NO_RELEASE
        elif "digest" in fields:
            self.release = f"{fields['release']} {str(fields['digest'])[:12]}"
        if self._reporter is None:
            self._early.append((event, line, fields))
        else:
            self._reporter.bundle = self.release
            self._reporter.tell(event, line, **fields)

    def begin(self, reporter: Reporter) -> None:
        """Tell it all, and from now on at once."""
        self._reporter = reporter
        for event, line, fields in self._early:
            reporter.tell(event, line, **fields)


def serve_store(
    folder: EcuFolder,
    access: AccessKey,
    config: Config,
    options: Options,
    *,
    software: str,
    is_stopped: Callable[[], bool],
    write: Callable[[str], object],
) -> Counters:
    """Run until stopped; the jets are shut on the bus at the end, whatever ended it. Raises StillwakeError if another
    process runs this ECU, the bus cannot be opened, a file cannot be written, or a reset failed within the process:
    whoever starts it again boots again.

    Args:
        access: shared with the tester.
        config: of the vehicle; its bus is a real one.
        is_stopped, write: as for `ecu.daemon.service.serve`.
    """
    check(config, options)
    times, log = PlanTimes(), Log()

    def controller_of(release: Bundle) -> Controller:
        controller = OnnxController.of(release)
        controller.warm_up(WARM_UP_STEPS)
        return TimedController(controller, clock.now_ns, times)

    equipment = Equipment(
        root=folder.root,
        access=access,
        random_bytes=secrets.token_bytes,
        hardware=folder.hardware,
        serial=folder.serial,
        software=software,
        controller_of=controller_of,
        log=log.tell,
    )
    with held(folder.folder), _switching():
        freshness, authentication = authentication_of(config, options)
        ecu = FlashableEcu(folder.backing(), config, equipment, authentication=authentication, serviced_apart=True)
        connections: list[Connection] = []
        fatal: list[BaseException] = []

        def failed(error: BaseException) -> None:
            goes_on = "the control goes on"
            if ecu.needs_reset:
                # No tester is heard any more, and only a reset would end the update.
                goes_on = "and with it the process"
                fatal.append(error)
            log.tell("diagnosis_ended", f"diagnosis ended, {goes_on}: {type(error).__name__}: {error}")

        diagnosis = DiagnosisThread(
            ecu,
            lambda frames: [connection.send(frames) for connection in connections],
            now_ns=clock.now_ns,
            failed=failed,
        )

        @contextmanager
        def beside(connection: Connection, reporter: Reporter) -> Iterator[None]:
            connections.append(connection)
            log.begin(reporter)
            with diagnosis:
                yield

        served = Served(
            ecu=ecu,
            times=times,
            name=log.release,
            line=f"runs ECU {folder.serial} ({folder.hardware}) from {folder.folder}, release {log.release},",
            fields={"serial": folder.serial, "hardware": folder.hardware, "release": log.release},
            hears=dict.fromkeys(config.bus.diagnosis.heard, diagnosis.put),
            beside=beside,
        )
        ends = lambda: bool(fatal) or is_stopped()  # noqa: E731
        counters = run(served, config, options, is_stopped=ends, write=write, freshness=freshness)
    if fatal:
        raise fatal[0]
    return counters


@contextmanager
def _switching() -> Iterator[None]:
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before)
