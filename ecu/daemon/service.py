"""The process of an ECU that runs one release. Everything is opened and tested before the first frame is sent."""

from collections.abc import Callable
from typing import Final

from contract.config.tree import Config
from contract.controller.calibration import Calibration
from contract.controller.interface import RunnableController
from contract.release.checks import Bundle
from ecu.daemon.counters import Counters
from ecu.daemon.process import ProcessOptions, ServedEcu, authentication_of, check, run
from ecu.ecu import Ecu
from ecu.fit import check_vehicle
from ecu.real_time import clock
from ecu.real_time.stage_times import TimedController

WARM_UP_STEPS: Final = 50
"""Number of warm-up steps of the controller on zeros, and of the ECU without frames. They take half a second."""


def serve(
    release: Bundle,
    controller: RunnableController,
    config: Config,
    options: ProcessOptions,
    *,
    is_stopped: Callable[[], bool],
    write: Callable[[str], object],
    signature: str,
    calibration: Calibration | None = None,
) -> Counters:
    """Run the ECU on a real bus until it is stopped. Its last frames shut the jets, whatever the cause of the end.
    `signature` says who signed the release; `calibration` is in force from the first step on. Raises StillwakeError
    if the release does not fit the vehicle, the bus cannot be opened, or a file cannot be written."""
    check_vehicle(release, config)
    check(config, options)
    freshness, authentication = authentication_of(config, options)
    controller.warm_up(WARM_UP_STEPS)
    timed = TimedController(controller, clock.now_ns)
    ecu = Ecu(release, timed, config, authentication)
    if calibration is not None:
        ecu.calibrate(calibration)
    now_ns = clock.now_ns()
    for _ in range(WARM_UP_STEPS):
        ecu.next(ecu.state, now_ns, [])
    name = f"{release.manifest.name} {release.digest[:12]}"
    served = ServedEcu(
        ecu=ecu,
        times=timed.times,
        name=name,
        line=f"runs bundle {name} ({signature}) by {controller.description}",
        fields={
            "bundle": release.manifest.name,
            "digest": release.digest,
            "signature": signature,
            "controller": controller.description,
        },
    )
    return run(served, config, options, is_stopped=is_stopped, write=write, freshness=freshness)
