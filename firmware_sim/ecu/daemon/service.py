"""From a release and settings to an ECU that runs: everything is opened and tried before the first frame goes out."""

import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

from can_bridge.bus.python_can import PythonCanBus
from can_bridge.secoc.freshness_store import FreshnessStore
from can_bridge.secoc.key import read_key
from can_bridge.secoc.node import Authentication
from can_bridge.wire.message_sets import message_set
from contract.atomic import check_writable
from contract.config.controller import CostWeights
from contract.config.tree import Config
from contract.controller.interface import RunnableController
from contract.errors import ConfigError
from contract.release.bundle import Bundle
from firmware_sim.ecu.daemon.connection import Connection
from firmware_sim.ecu.daemon.control_loop import ControlLoop, RealTime, check_offset
from firmware_sim.ecu.daemon.counters import Counters
from firmware_sim.ecu.daemon.events import Event, plain
from firmware_sim.ecu.daemon.reception import Reception
from firmware_sim.ecu.daemon.reporter import Reporter
from firmware_sim.ecu.daemon.systemd import Notifier
from firmware_sim.ecu.ecu import Ecu
from firmware_sim.ecu.fit import check_vehicle
from firmware_sim.ecu.other_ecu import is_of_another_ecu
from firmware_sim.ecu.real_time import clock
from firmware_sim.ecu.real_time.privileges import Wanted, in_words, taken
from firmware_sim.ecu.real_time.stage_times import LONGEST, EcuStage, StageTimes
from firmware_sim.ecu.real_time.timed_controller import TimedController

WARM_UP_STEPS: Final = 50
"""Of the controller on zeros, and of the ECU without frames: what happens once has then happened. Half a second."""
FRESHNESS: Final = "freshness.json"
"""In the state directory that systemd gives a service."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What is no setting of the ECU but of its process.

    Attributes:
        wanted: privileges.
        spin_ns: `clock.sleep_until`.
        periods: after which it ends by itself; None for never.
        stage_times: file for the stages of each period, written at the end.
        metrics: file of counters for Prometheus.
        freshness: file that outlives a power cycle, needed with `bus.key`.
        as_line: how an event is written.
        environment: of the process.
    """

    wanted: Wanted = field(default_factory=Wanted)
    spin_ns: int = 0
    periods: int | None = None
    stage_times: Path | None = None
    metrics: Path | None = None
    freshness: Path | None = None
    as_line: Callable[[Event], str] = plain
    environment: Mapping[str, str] = field(default_factory=lambda: dict(os.environ))


def serve(
    release: Bundle,
    controller: RunnableController,
    config: Config,
    options: Options,
    *,
    is_stopped: Callable[[], bool],
    write: Callable[[str], object],
    signature: str,
    weights: CostWeights | None = None,
    open_bus: Callable[[], PythonCanBus] | None = None,
) -> Counters:
    """Run until stopped; the jets are shut on the bus at the end, whatever ended it.

    Args:
        release: verified.
        controller: of the release.
        config: of the vehicle; its bus is a real one.
        options: of the process.
        is_stopped: looked at once a period.
        write: one line of the log.
        signature: what the release's is worth, in words.
        weights: of the cost, in place of the release's.
        open_bus: opens it; by the settings without.

    Raises:
        StillwakeError: the release does not fit the vehicle, the bus cannot be opened, or a file cannot be written.
    """
    check_vehicle(release, config)
    check_offset(config)
    for path in (options.stage_times, options.metrics):
        if path is not None:
            check_writable(path)
    messages = message_set(config.bus)
    pressure = messages.pressure.spec
    store, authentication = _authentication(config, options)
    controller.warm_up(WARM_UP_STEPS)
    timed = TimedController(controller, clock.now_ns)
    ecu = Ecu(release, timed, config, weights=weights, authentication=authentication)
    now_ns = clock.now_ns()
    for _ in range(WARM_UP_STEPS):
        ecu.next(ecu.state, now_ns, [])
    key = None if authentication is None else authentication.key
    reception = Reception(
        pressure=pressure,
        of_another_ecu=lambda frame: is_of_another_ecu(frame, messages, key),
        interface=config.bus.interface,
    )
    stages = None
    if options.stage_times is not None:
        stages = StageTimes(EcuStage, LONGEST if options.periods is None else options.periods)

    def opened() -> PythonCanBus:
        return PythonCanBus.open(config.bus, accept={spec.frame_id for spec in messages.specs})

    def keep(counters: Counters) -> None:
        if store is not None:
            store.accepted(pressure.frame_id, counters.state.verifier.freshness)

    name = f"{release.manifest.name} {release.digest[:12]}"
    with ExitStack() as stack:
        privileges = stack.enter_context(taken(options.wanted))
        notifier = Notifier(options.environment, os.getpid())
        stack.callback(notifier.close)
        connection = stack.enter_context(Connection(opened if open_bus is None else open_bus, reception.put))
        reporter = stack.enter_context(
            Reporter(write, options.as_line, bundle=name, metrics=options.metrics, keep=keep)
        )

        def tell(event: str, line: str, **fields: str | int | float) -> None:
            reporter.tell(event, line, **fields)
            notifier.status(line)

        def after_step(now_ns: int, counters: Counters) -> None:
            reporter.counters = counters
            if counters.steps == 1:
                notifier.ready("OFF")
            notifier.came_through(now_ns)

        loop = ControlLoop(
            ecu,
            timed,
            connection,
            reception,
            config,
            tell=tell,
            after_step=after_step,
            stage_times=stages,
            real_time=RealTime(sleep_until=partial(clock.sleep_until, spin_ns=options.spin_ns)),
        )
        bus = f"{config.bus.interface} {config.bus.channel!r}, {messages.name}"
        period_ms = config.period_ns / 1e6
        tell(
            "runs",
            f"runs bundle {name} ({signature}) by {controller.description} on {bus}, period {period_ms:g} ms; "
            f"granted: {in_words(privileges)}",
            bundle=release.manifest.name,
            digest=release.digest,
            signature=signature,
            controller=controller.description,
            interface=config.bus.interface,
            channel=config.bus.channel,
            period_ms=period_ms,
            privileges=in_words(privileges),
        )
        try:
            loop.run(is_stopped, options.periods)
        finally:
            notifier.stopping()
            loop.shut()
        steps = loop.counters.steps
        tell("stopped", f"jets shut after {steps} steps, {loop.counters.left_out} periods left out", steps=steps)
    if stages is not None and options.stage_times is not None:
        stages.save(options.stage_times)
    return loop.counters


def freshness_file(options: Options) -> Path:
    """Where freshness values outlive a power cycle; raises ConfigError if nobody says where."""
    if options.freshness is not None:
        return options.freshness
    folder = options.environment.get("STATE_DIRECTORY", "").partition(":")[0]
    if not folder:
        raise ConfigError("bus.key: name the file that keeps freshness values over a restart with --freshness FILE")
    return Path(folder) / FRESHNESS


def _authentication(config: Config, options: Options) -> tuple[FreshnessStore | None, Authentication | None]:
    if not config.bus.key:
        return None, None
    key = read_key(Path(config.bus.key))
    store = FreshnessStore(freshness_file(options))
    return store, store.begin(key)
