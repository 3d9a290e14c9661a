"""The example for Linux, against a bus that the test plays."""

import os
import select
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, cast

import pytest

from can_bridge.secoc.key import Key, write_key
from can_bridge.secoc.securing import Authentication
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import MessageSet
from can_bridge.wire.messages import Mode
from ecu.in_c.compiler import host_compiler
from tests.ecu.daemon.driving import Vehicle
from tests.ecu.examples.conftest import START, both_sets, without
from tests.ecu.in_c.test_secoc_in_c import SECRET

BUS = Path(__file__).with_name("c").joinpath("bus.c").read_bytes()
WRAPPED = ("-Wl,--wrap=socket", "-Wl,--wrap=bind", "-Wl,--wrap=ioctl", "-Wl,--wrap=setsockopt")
FD_FRAME, CLASSIC_FRAME = struct.Struct("=IB3x64s"), struct.Struct("=IB3x8s")  # Linux's canfd_frame and can_frame
BUS_OFF = CLASSIC_FRAME.pack(0x20000000 | 0x40, 8, bytes(8))
"""An error frame: CAN_ERR_FLAG and CAN_ERR_BUSOFF of linux/can/error.h."""


@pytest.fixture(scope="session")
def linux_program(folder, tmp_path_factory, shared_builds) -> Callable[..., Path]:
    """`main_socketcan.c` with a bus in place of the kernel's, or without."""
    if not sys.platform.startswith("linux"):
        pytest.skip("SocketCAN is Linux's")
    contents = without(folder, "systick.c", "pressures.h", "mps2_an500.ld", *START)
    place = tmp_path_factory.mktemp("socketcan")

    def build(name: str, *flags: str, **others: bytes) -> Path:
        path = place / name
        given = contents | {f"{other}.c": text for other, text in others.items()}
        shared_builds.compile_c(given, path, compiler=host_compiler(), flags=("-O1", "-ffp-contract=off", *flags))
        return path

    return build


def test_without_an_interface_the_linux_program_says_so(linux_program):
    program = linux_program("ecu")
    cannot = "CAN interface no_such_bus cannot be opened: "
    for arguments, words in (([], "usage: ecu INTERFACE"), (["no_such_bus"], cannot)):
        done = subprocess.run([program, *arguments], capture_output=True, text=True, timeout=60, check=False)
        assert done.stderr.startswith(words)
        assert (done.returncode, done.stderr.count("\n")) == (1, 1)


@contextmanager
def started(program: Path, *others: Path) -> Iterator[tuple[subprocess.Popen[bytes], socket.socket, socket.socket]]:
    """The Linux program, which does not outlive the block, our end of its bus, and its own end."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    ours.setblocking(False)
    command: list[Path | str] = [program, "can0", *others]
    at = theirs.fileno()
    environment = os.environ | {"BUS": str(at)}
    with ours, theirs, subprocess.Popen(command, env=environment, pass_fds=[at], stderr=subprocess.PIPE) as running:
        try:
            yield running, ours, theirs
        finally:
            running.kill()


class SocketBus:
    """This end of the socket as a bus, on which none but the ECU's frames come."""

    def __init__(self, end: socket.socket, messages: MessageSet) -> None:
        self._end, self._messages = end, messages
        self._form = FD_FRAME if messages.command.spec.is_fd else CLASSIC_FRAME

    def send(self, frame: Frame) -> None:
        self._end.send(self._form.pack(frame.frame_id, len(frame.data), frame.data))

    def receive_all(self) -> list[Frame]:
        frames = []
        with suppress(BlockingIOError):
            while True:
                identifier, length, content = self._form.unpack(self._end.recv(128))
                frames.append(Frame(frame_id=identifier, data=content[:length]))
        specs = self._messages.command.spec, self._messages.status.spec
        assert {(one.frame_id, len(one.data)) for one in frames} <= {(spec.frame_id, spec.length) for spec in specs}
        return frames


@pytest.mark.processes
@both_sets
def test_the_linux_program_drives_the_jets_and_ends_with_them_shut(linux_program, built_for):
    config, messages = built_for
    program = linux_program("ecu_on_a_socket", *WRAPPED, bus=BUS)
    with started(program) as (running, ours, _):
        vehicle = Vehicle(config, cast(Any, SocketBus(ours, messages)))
        vehicle.into_control()
        ours.send(BUS_OFF)
        vehicle.until(lambda: vehicle.commands[-1].mode is Mode.FAULT, request=True)
        assert not vehicle.commands[-1].enable
        running.send_signal(signal.SIGTERM)
        assert running.wait(timeout=60) == 0
        vehicle.period(request=True)
    last = vehicle.commands[-3:]
    assert [(command.mode, command.enable, command.flow_m2_per_s) for command in last] == [(Mode.OFF, False, 0.0)] * 3
    assert all(command.next_period == config.ecu.plan_ahead for command in vehicle.commands)


@pytest.mark.processes
def test_a_bus_that_takes_nothing_does_not_hold_the_linux_program_up(linux_program):
    """Nobody reads: after some frames a send would wait, and the program with it, even at its end."""
    program = linux_program("ecu_on_a_socket", *WRAPPED, bus=BUS)
    with started(program) as (running, _, theirs):
        theirs.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)  # few frames then fill it
        poller, end = select.poll(), time.monotonic() + 60.0
        poller.register(theirs, select.POLLOUT)
        while poller.poll(0):  # this end takes more
            assert time.monotonic() < end
            time.sleep(0.02)
        running.send_signal(signal.SIGTERM)
        assert running.wait(timeout=60) == 0


@pytest.mark.processes
@pytest.mark.parametrize("built_for", ["secured"], indirect=True)
def test_with_a_key_it_keeps_the_freshness_also_if_the_interface_fails(linux_program, built_for, tmp_path):
    """That of a speed as well, which this release does not need: recorded frames would be accepted again."""
    config, messages = built_for
    program = linux_program("ecu_with_a_key", *WRAPPED, bus=BUS)
    key, kept = tmp_path / "bus.key", tmp_path / "freshness"
    write_key(key, SECRET)
    kept.write_text("4 0 7\n")
    for trip, fails in ((5, False), (6, True)):
        with started(program, key, kept) as (running, ours, _):
            vehicle = Vehicle(config, cast(Any, SocketBus(ours, messages)), Authentication(key=Key(SECRET), trip=trip))
            vehicle.into_control()
            if fails:
                ours.close()
            else:
                running.send_signal(signal.SIGTERM)
            assert running.wait(timeout=60) == fails
        stored, pressure, speed = map(int, kept.read_text().split())
        assert (stored, pressure >> 32, speed) == (trip, trip, 7)
    for digits in (31, 33, 64):
        key.write_text(digits * "1" + "\n")
        with started(program, key, kept) as (running, *_):
            assert running.wait(timeout=60) == 1
