"""A run of the vehicle's side: `VehicleLoop` with its bus, receive thread, privileges and clock."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from can_bridge.bus.backends.python_can import PythonCanBus, ReceiveThread
from can_bridge.bus.heard import SILENCE_S, Heard, Silence
from can_bridge.secoc.freshness_store import FreshnessStore
from can_bridge.secoc.key import read_key
from can_bridge.wire.message_sets import message_set
from contract.config.tree import Config
from contract.errors import ConfigError
from ecu.real_time import clock
from ecu.real_time.deadlines import Deadlines
from ecu.real_time.inbox import Inbox
from ecu.real_time.privileges import Wanted, in_words, taken
from ecu.real_time.stage_times import USUAL_PERIODS, StageTimes, VehicleStage
from firmware_sim.bench.real_time.vehicle_loop import Pressures, VehicleFigures, VehicleLoop
from firmware_sim.bench.vehicle_node import VehicleNode
from wake.plant.drive import Drive

LEAD_IN_NS: Final = 50_000_000
"""Time in ns from the start of the loop to its first sampling instant."""
_ROOM: Final = 4096  # frames stored in a period, about as many as a full classic bus carries in one second
WRITTEN_EVERY: Final = 500
"""Number of periods between two writes of the freshness file: 500 periods of 20 ms are ten seconds."""


@dataclass(frozen=True, kw_only=True)
class Course:
    """The length, drive and files of a run. `periods` is None for an endless run. Control is first requested after
    `enable_after_s` s; None means no request. The file `freshness` counts the node's power cycles; it is required with
    `bus.key`, and not allowed without it. The file `frames` gets the frames that the vehicle sent and accepted."""

    periods: int | None = None
    enable_after_s: float | None = 2.0
    stage_times: Path | None = None
    freshness: Path | None = None
    frames: Path | None = None
    wanted: Wanted = field(default_factory=Wanted)
    drive: Drive | None = None


def run_vehicle(
    bus: PythonCanBus,
    sensors: Sequence[str],
    pressures: Pressures,
    config: Config,
    course: Course,
    *,
    is_stopped: Callable[[], bool] = lambda: False,
    report: Callable[[str], None] = lambda line: None,
    progress: Callable[[VehicleFigures], None] = lambda figures: None,
) -> VehicleFigures:
    """Run until `course` ends or `is_stopped` is true; then withdraw the request for control on the bus. `sensors` are
    in the order of the Pressure message. Raises ConfigError if only one of `bus.key` and the freshness file is set, or
    the pressures lack a sensor; BusError if the bus is lost; StillwakeError if a file or the live wake fails."""
    store, node = _node(sensors, pressures, config, course)
    per_second = max(1, round(SILENCE_S * 1e9 / config.period_ns))
    enable_from = None if course.enable_after_s is None else round(course.enable_after_s * 1e9 / config.period_ns)
    times = None if course.stage_times is None else StageTimes(VehicleStage, course.periods or USUAL_PERIODS)
    bus.receive_all()  # discards the frames that arrived before the run
    # A frame's time of arrival is when the receive thread reads it, so the transmission includes the kernel's delay.
    inbox = Inbox(lambda frame: clock.now_ns(), room=_ROOM)
    with ExitStack() as stack:
        if store is not None:
            # The freshness value is stored even on failure; otherwise recorded commands could be replayed afterwards.
            keep = store.accepted
            stack.callback(lambda: keep(*node.accepted_freshness))
        report(f"real time: {in_words(stack.enter_context(taken(course.wanted)))}")
        receiving = stack.enter_context(ReceiveThread(bus, inbox.put))
        first_ns = clock.now_ns() + LEAD_IN_NS
        deadlines = Deadlines(period_ns=config.period_ns, due_ns=first_ns, grace_ns=config.period_ns // 2)
        loop = VehicleLoop(config, node, pressures, bus.send, inbox, deadlines, stage_times=times)
        messages = message_set(config.bus)
        silence = Silence(messages.command.spec, messages, "ECU", report)
        figures, begun, has_given_up = loop.figures, 0, False
        while not is_stopped() and (course.periods is None or begun < course.periods):
            if course.drive is not None:
                # In a period without pressures, the live wake's time stands still. The drive's time must stop, too.
                driven_s = (begun - figures.unsampled) * config.period_ns / 1e9
                node.speed = node.stated_speed = course.drive.speed(driven_s)
            loop.period(enable_request=enable_from is not None and begun >= enable_from)
            begun += 1
            if node.has_given_up and not has_given_up:
                has_given_up = True
                lost = f"{config.vehicle.loss_limit} of {config.vehicle.loss_window} periods had no usable command"
                report(f"{lost}: the jets are shut, and the vehicle requests no more control (vehicle.loss_limit)")
            receiving.check()
            if begun % per_second == 0:
                silence.look(figures.commands, loop.heard, bus.rejected)
                loop.heard = Heard()
            if begun % max(1, per_second // 2) == 0:
                progress(figures)
            if store is not None and begun % WRITTEN_EVERY == 0:
                store.accepted(*node.accepted_freshness)
        loop.finish()
    if times is not None and course.stage_times is not None:
        times.save(course.stage_times)
    if inbox.dropped:
        report(f"{inbox.dropped} frames arrived faster than they could be processed, and were lost")
    return figures


def _node(
    sensors: Sequence[str], pressures: Pressures, config: Config, course: Course
) -> tuple[FreshnessStore | None, VehicleNode]:
    store, authentication = None, None
    if config.bus.key:
        if course.freshness is None:
            raise ConfigError(f"bus.key = {config.bus.key!r}: needs --freshness FILE, which counts the power cycles")
        store = FreshnessStore(course.freshness, every=1)
        authentication = store.begin(read_key(Path(config.bus.key)))
    elif course.freshness is not None:
        raise ConfigError(f"--freshness {course.freshness}: needs a key, but bus.key is empty")
    return store, VehicleNode(sensors, config, pressures.layout, authentication)
