"""Two processes on a real bus: pressures go out in step with the period, and each is answered by a jet command.

    python -m benchmarks two-nodes --garbage 1 --json results/two_nodes.json
    python -m benchmarks two-nodes slcan pty --frames classic

Every frame is end-to-end protected and counted at both ends. Nothing here plans: the answer is a fixed command with the
counter of the pressures that it answers, so that what is measured is the bus.
"""

import multiprocessing
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing.connection import Connection
from random import Random
from typing import Annotated, Any, Final

import numpy as np
import typer
from rich.table import Table

from benchmarks.bus.garbage import garbage_datagram, garbage_line
from benchmarks.bus.serial_wire import SerialWire
from benchmarks.common.command_line import JsonFile, console, save
from benchmarks.common.command_line import progress as progress_console
from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.receiver import Check, E2eReceiver
from can_bridge.e2e.sender import E2eSender
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import JetCommand, Mode, Pressure
from contract.config.vehicle import BusConfig
from contract.errors import BusError
from contract.results import versions
from stillwake.console.terminal import progress_bar

PATIENCE_S: Final = 30.0
"""For the other process to start, and to stop."""
LAST_ANSWERS_S: Final = 2.0
"""For what is still under way when the last period has ended."""
_POLL_S: Final = 0.02

UDP_PORT: Final = 43113
"""The channel of python-can's udp_multicast."""

Counts = dict[str, Any]


def measure(
    config: BusConfig,
    *,
    periods: int,
    period_s: float = 0.02,
    vehicle: BusConfig | None = None,
    settle_s: float = 2.0,
    between: Callable[[int], None] = lambda period: None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Counts:
    """Run both nodes and count.

    Args:
        config: the bus, as the answering process opens it.
        periods: pressures to send.
        period_s: time between two of them, in s.
        vehicle: the bus as this process opens it, where that differs: the other serial port.
        settle_s: what a serial adapter is given to start, in s.
        between: called once a period, after sending; the place for disturbances.
        progress: called with periods done and in all.

    Returns:
        For each direction the frames sent, those that came with the next counter (`good`), what else the end-to-end
        checks found, what the bus refused by reason, and overflows; `round_trip_ms` from the call that sends pressures
        to the answer in hand, as p50, p99, p99.9 and max; `answered_late`, answers after their period.

    Raises:
        BusError: if either node's bus cannot be opened or fails, or the other process does not start.
    """
    with _answering(config, settle_s) as ecu:
        with PythonCanBus.open(vehicle or config, accept=(_command_id(config),), settle_s=settle_s) as bus:
            driver = _Vehicle(bus, config)
            start = time.monotonic()
            for period in range(periods):
                driver.send(period)
                between(period)
                driver.listen_until(start + (period + 1) * period_s)
                progress(period + 1, periods)
            driver.listen_until(time.monotonic() + LAST_ANSWERS_S, expected=periods)
            bus.receive_all()
            commands = _counts(bus, driver.commands)
        ecu.send("stop")
        pressures = _received(ecu)
    commands["sent"] = pressures.pop("answers")
    pressures["sent"] = periods
    return {
        "pressures": pressures,
        "commands": commands,
        "answered_late": sum(1e-3 * took > period_s for took in driver.took_ms),
        "round_trip_ms": _percentiles(driver.took_ms),
    }


def run(
    config: BusConfig,
    *,
    periods: int,
    period_s: float = 0.02,
    garbage: int = 0,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Counts:
    """As `measure`, with so many unusable datagrams or lines from a third party in each period.

    A channel `pty` of slcan becomes two pseudo-terminals with two adapters and a CAN bus between them. On other buses
    than these there is no garbage to be had.

    Raises:
        BusError: as `measure`, or for garbage on another bus.
    """
    rng = Random(seed)
    if (config.interface, config.channel) == ("slcan", "pty"):
        with SerialWire() as wire:
            ecu, vehicle = (replace(config, channel=port) for port in wire.ports)
            figures = measure(
                ecu,
                vehicle=vehicle,
                periods=periods,
                period_s=period_s,
                settle_s=0.0,
                between=lambda period: wire.disturb([garbage_line(rng) for _ in range(garbage)]),
                progress=progress,
            )
            return figures | {"garbage": periods * garbage}
    if garbage and config.interface != "udp_multicast":
        raise BusError(f"bus.interface = {config.interface}: garbage can be put on udp_multicast and on slcan pty")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as third:
        third.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)

        def disturb(period: int) -> None:
            for _ in range(garbage):
                third.sendto(garbage_datagram(rng), (config.channel, UDP_PORT))

        figures = measure(config, periods=periods, period_s=period_s, between=disturb, progress=progress)
    return figures | {"garbage": periods * garbage}


def lost(counts: Counts) -> int:
    """Frames of both directions that did not come as the next one."""
    return sum(counts[name]["sent"] - counts[name]["good"] for name in ("pressures", "commands"))


class _Vehicle:
    """The node of this process."""

    def __init__(self, bus: PythonCanBus, config: BusConfig) -> None:
        self._bus = bus
        self._set = message_set(config)
        self._pressures = E2eSender(self._set.pressure.spec)
        self._profile = profile_of(self._set.pressure.spec)
        self._sent_at: dict[int, float] = {}
        self.commands = E2eReceiver(self._set.command.spec, config.e2e)
        self.took_ms: list[float] = []

    def send(self, period: int) -> None:
        message = Pressure(
            pressure_pa=(float(period % 100), 0.0, -1.0, 2.0), valid=(True,) * 4, enable_request=True, age_ns=0
        )
        frame = self._pressures.frame(self._set.pressure.emit(message), now_ns=time.time_ns())
        self._sent_at[self._profile.counter_of(frame.data)] = time.monotonic()
        self._bus.send(frame)

    def listen_until(self, deadline: float, *, expected: int | None = None) -> None:
        """Until the deadline, or so many answers."""
        while (left := deadline - time.monotonic()) > 0.0 and len(self.took_ms) != expected:
            frame = self._bus.receive(left)
            if frame is None:
                continue
            reception = self.commands.tick([frame])
            answer = None if reception.accepted is None else self._set.command.parse(reception.accepted.data)
            if answer is not None and answer.pressure_counter is not None:
                self.took_ms.append(1e3 * (time.monotonic() - self._sent_at[answer.pressure_counter]))


def _answer(config: BusConfig, settle_s: float, parent: Connection) -> None:
    """The other process: answer each good frame of pressures until it is stopped."""
    # Ctrl-C reaches the whole group of a terminal; the parent ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    used = message_set(config)
    receiver, sender = E2eReceiver(used.pressure.spec, config.e2e), E2eSender(used.command.spec)
    profile = profile_of(used.pressure.spec)
    answers = 0

    def answer(frame: Frame) -> Frame | None:
        accepted = receiver.tick([frame]).accepted
        if accepted is None or used.pressure.parse(accepted.data) is None:
            return None
        counter = profile.counter_of(accepted.data)
        command = JetCommand(flow_m2_per_s=0.5, mode=Mode.CONTROL, enable=True, pressure_counter=counter)
        return sender.frame(used.command.emit(command), now_ns=time.time_ns())

    try:
        with PythonCanBus.open(config, accept=(used.pressure.spec.frame_id,), settle_s=settle_s) as bus:
            parent.send("ready")
            while not parent.poll():
                frame = bus.receive(_POLL_S)
                command = None if frame is None else answer(frame)
                if command is not None:
                    bus.send(command)
                    answers += 1
            for frame in bus.receive_all():
                receiver.tick([frame])
            parent.send({**_counts(bus, receiver), "answers": answers})
    except BusError as error:
        parent.send(error)


@contextmanager
def _answering(config: BusConfig, settle_s: float) -> Iterator[Connection]:
    """The other process, from its bus being open on; it ends with the block."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_answer, args=(config, settle_s, theirs), daemon=True)
    process.start()
    theirs.close()
    try:
        if _received(ours) != "ready":
            raise BusError("the answering process did not report that it is ready")
        yield ours
        process.join(PATIENCE_S)
    finally:
        process.terminate()
        process.join()
        ours.close()


def _received(connection: Connection) -> Any:
    """What the other process reports; raises what it raised."""
    try:
        found = connection.recv() if connection.poll(PATIENCE_S) else BusError("the answering process reports nothing")
    except EOFError:
        found = BusError("the answering process ended")
    if isinstance(found, BusError):
        raise found
    return found


def _command_id(config: BusConfig) -> int:
    return message_set(config).command.spec.frame_id


def _counts(bus: PythonCanBus, receiver: E2eReceiver) -> Counts:
    checks = {check.name: receiver.state.count(check) for check in Check}
    return {
        "good": checks.pop("OK"),
        "other_checks": {name: count for name, count in checks.items() if count},
        "refused": {reason.value: count for reason, count in bus.rejected.items() if count},
        "overflows": bus.overflows,
    }


def _percentiles(values: list[float]) -> Counts:
    if not values:
        return {}
    p50, p99, p999 = np.percentile(values, [50.0, 99.0, 99.9])
    return {"p50": float(p50), "p99": float(p99), "p99.9": float(p999), "max": max(values)}


def main(
    interface: Annotated[str, typer.Argument(help="As in bus.interface.")] = "udp_multicast",
    channel: Annotated[
        str, typer.Argument(help="As in bus.channel; `pty` for slcan over two pseudo-terminals.")
    ] = "239.74.163.2",
    json_file: JsonFile = None,
    frames: Annotated[str, typer.Option(help="fd or classic.")] = "fd",
    periods: Annotated[int, typer.Option(help="Pressures to send.", min=1)] = 3000,
    period_ms: Annotated[float, typer.Option(help="Between two of them.", min=0.1)] = 20.0,
    garbage: Annotated[int, typer.Option(help="Unusable datagrams or lines in each period.", min=0)] = 0,
) -> None:
    """Run both nodes on one bus and print what arrived; status 1 if any frame did not."""
    config = BusConfig(interface=interface, channel=channel, frames=frames)  # type: ignore[arg-type]  # it checks
    with progress_bar("periods", estimate_over=60.0, console=progress_console) as bar:
        task = bar.add_task("two nodes", total=periods, note="")
        figures = run(
            config,
            periods=periods,
            period_s=1e-3 * period_ms,
            garbage=garbage,
            progress=lambda done, total: bar.update(task, completed=done),
        )
    table = Table("message", "sent", "good", "otherwise checked", "refused by the bus", "overflows")
    for name in ("pressures", "commands"):
        row = figures[name]
        others = (
            ", ".join(f"{key} {count}" for key, count in row[item].items()) for item in ("other_checks", "refused")
        )
        table.add_row(name, str(row["sent"]), str(row["good"]), *others, str(row["overflows"]))
    console.print(table)
    times = ", ".join(f"{name} {value:.2f}" for name, value in figures["round_trip_ms"].items())
    console.print(f"round trip in ms: {times}; {figures['answered_late']} answered after their period")
    facts = {
        "interface": interface,
        "frames": frames,
        "period_ms": period_ms,
        "garbage": garbage,
        "versions": versions("python-can"),
    }
    save(json_file, figures=figures, facts=facts)
    raise typer.Exit(int(lost(figures) > 0))
