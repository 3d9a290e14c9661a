"""The process around an ECU's control loop: bus, privileges, log, counters, systemd. It shuts the jets when it ends."""

import os
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Final

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.secoc.freshness_store import FreshnessStore
from can_bridge.secoc.key import read_key
from can_bridge.secoc.securing import Authentication
from can_bridge.tools.measurement import check_measurement, live_log
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import SETS, message_set
from contract.atomic import check_writable
from contract.config.diagnosis import CanId
from contract.config.tree import Config
from contract.controller.calibration import Calibration
from contract.controller.interface import RunnableController
from contract.errors import ConfigError
from contract.release.checks import Bundle
from ecu.daemon.connection import Connection
from ecu.daemon.control_loop import ControlLoop
from ecu.daemon.reception import FrameReception
from ecu.daemon.reporter import Counters, DatedEvent, Reporter, plain
from ecu.daemon.systemd import Notifier
from ecu.ecu import Ecu
from ecu.fit import check_offset, check_vehicle
from ecu.real_time import clock
from ecu.real_time.privileges import Wanted, in_words, taken
from ecu.real_time.stage_times import USUAL_PERIODS, EcuStage, PlanTimes, StageTimes, TimedController
from ecu.stepped import SteppedEcu

FRESHNESS: Final = "freshness.json"
"""Name of the file with the freshness values, in the state directory that systemd gives to a service."""


@dataclass(frozen=True, kw_only=True)
class ProcessOptions:
    """The options of one process.

    Attributes:
        periods: number of periods after which the process ends; None for no limit.
        stage_times, frames: files for the times of each period's stages, and for the sent and accepted frames.
        metrics: file to which the counters are written for Prometheus.
        freshness: file that stores freshness values over a power cycle, needed with `bus.key`.
    """

    wanted: Wanted = field(default_factory=Wanted)
    spin_ns: int = 0
    periods: int | None = None
    stage_times: Path | None = None
    metrics: Path | None = None
    freshness: Path | None = None
    frames: Path | None = None
    as_line: Callable[[DatedEvent], str] = plain
    environment: Mapping[str, str] = field(default_factory=lambda: dict(os.environ))


def freshness_file(options: ProcessOptions) -> Path:
    """Return the file of freshness values. Raises ConfigError if neither the options nor systemd name a place."""
    if options.freshness is not None:
        return options.freshness
    folder = options.environment.get("STATE_DIRECTORY", "").partition(":")[0]
    if not folder:
        raise ConfigError("bus.key: needs --freshness FILE, which stores the freshness values")
    return Path(folder) / FRESHNESS


def authentication_of(config: Config, options: ProcessOptions) -> tuple[FreshnessStore | None, Authentication | None]:
    """Return the freshness store, and the authentication for a new power cycle; (None, None) without `bus.key`. Raises
    KeyFileError if the key cannot be read, and the errors of `FreshnessStore.begin`."""
    if not config.bus.key:
        return None, None
    key, store = read_key(Path(config.bus.key)), FreshnessStore(freshness_file(options))
    return store, store.begin(key)


def check(config: Config, options: ProcessOptions) -> None:
    """Raise StillwakeError if the step offset is too long, or an output file cannot be written."""
    check_offset(config)
    for path in (options.stage_times, options.metrics):
        if path is not None:
            check_writable(path)
    if options.frames is not None:
        check_measurement(options.frames)


def reporter_of(
    config: Config, options: ProcessOptions, freshness: FreshnessStore | None, write: Callable[[str], object], name: str
) -> Reporter:
    """Return the thread for log, counters and freshness values, which `run` starts. `name` is the release's name."""
    messages = message_set(config.bus)

    def keep(counters: Counters) -> None:
        if freshness is not None:
            freshness.accepted(messages.pressure.spec.frame_id, counters.state.verifier.freshness)
            freshness.accepted(messages.speed.spec.frame_id, counters.state.speed.verifier.freshness)

    return Reporter(write, options.as_line, bundle=name, metrics=options.metrics, keep=keep)


def run(
    ecu: SteppedEcu,
    times: PlanTimes,
    reporter: Reporter,
    config: Config,
    options: ProcessOptions,
    *,
    is_stopped: Callable[[], bool],
    line: str,
    fields: Mapping[str, str | int | float],
    hears: Mapping[CanId, Callable[[Frame], None]] = MappingProxyType({}),
    beside: Callable[[Connection], AbstractContextManager[object]] = nullcontext,
) -> Counters:
    """Run an ECU until it is stopped; see `serve`. `line` and `fields` describe it in the log. The thread that reads
    the bus passes each frame whose identifier is in `hears` to the function for it. `beside` returns a context that
    is active while the bus is open."""
    messages = message_set(config.bus)
    reception = FrameReception(messages=messages, interface=config.bus.interface)
    stages = None if options.stage_times is None else StageTimes(EcuStage, options.periods or USUAL_PERIODS)

    def opened() -> PythonCanBus:
        # Frames of the other message sets are accepted too, so that the ECU can report a node with a wrong message set.
        accept = [spec.frame_id for known in SETS for spec in known.specs] + list(hears)
        return PythonCanBus.open(config.bus, accept=accept, keep=kept)

    def deliver(frame: Frame) -> None:
        hears.get(frame.identifier, reception.put)(frame)

    with ExitStack() as stack:
        # The log's thread starts before the process takes its privileges, so the log's thread does not get them.
        kept = stack.enter_context(live_log(options.frames))
        privileges = stack.enter_context(taken(options.wanted))
        notifier = Notifier(options.environment, os.getpid())
        stack.callback(notifier.close)
        connection = stack.enter_context(Connection(opened, deliver))
        stack.enter_context(reporter)

        def tell(event: str, text: str, **about: str | int | float) -> None:
            reporter.tell(event, text, **about)
            notifier.status(text)

        def after_step(now_ns: int, counters: Counters) -> None:
            reporter.counters = counters
            if counters.steps == 1:
                notifier.ready("OFF")
            notifier.came_through(now_ns)

        loop = ControlLoop(
            ecu,
            times,
            connection,
            reception,
            config,
            tell=tell,
            after_step=after_step,
            stage_times=stages,
            sleep_until=partial(clock.sleep_until, spin_ns=options.spin_ns),
        )
        bus = f"{config.bus.interface} {config.bus.channel!r}, {messages.name}"
        period_ms = config.period_ns / 1e6
        tell(
            "runs",
            f"{line} on {bus}, period {period_ms:g} ms; granted: {in_words(privileges)}",
            **fields,
            interface=config.bus.interface,
            channel=config.bus.channel,
            period_ms=period_ms,
            privileges=in_words(privileges),
        )
        with beside(connection):
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


WARM_UP_STEPS: Final = 50
"""Number of warm-up steps of the controller (on zeros), and then of the ECU (without frames): half a second in all."""


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
    name, by = f"{release.manifest.name} {release.digest[:12]}", controller.description
    line = f"runs bundle {name} ({signature}) by {by}"
    fields = {"bundle": release.manifest.name, "digest": release.digest, "signature": signature, "controller": by}
    reporter = reporter_of(config, options, freshness, write, name)
    return run(ecu, timed.times, reporter, config, options, is_stopped=is_stopped, line=line, fields=fields)
