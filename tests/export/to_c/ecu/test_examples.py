"""The example programs around the ECU in C: under SysTick on QEMU's Cortex-M7, and on Linux against a played bus.

QEMU takes 2 ns an instruction: a core of 480 MHz that issues about one a cycle.
"""

import os
import re
import select
import shutil
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from can_bridge.e2e.receiver import Check, E2eReceiver, StreamState
from can_bridge.e2e.sender import E2eSender
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import MessageSet, message_set
from can_bridge.wire.messages import JetCommand, Mode, Pressure
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.config.tree import Config
from contract.controller.c_folder import write_folder
from contract.controller.compiler import host_compiler, zig_compiler
from contract.release.bundle import load
from export.program.random_program import random_program, random_windows
from export.release.lowering import int8_library
from export.to_c.folder_files import documents
from export.to_c.library import ecu_sources, example_sources
from firmware_sim.ecu.c_examples import ASKED_FROM, PLAYED, played_pressures
from firmware_sim.ecu.c_settings import HEADER, ecu_settings
from tests.export.to_c.ecu.wire_parts import FRAMES, vehicle

QEMU = shutil.which("qemu-system-arm") or ""
CORTEX_M7 = (
    "-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m7+fp_armv8d16sp", "-ffreestanding", "-O2",
    "-ffp-contract=on", "-g0", "-T", "mps2_an500.ld", "-Wl,-e,reset",
)  # fmt: skip
MODEL = ModelConfig(latent=3, lstm_width=8, dynamics_width=16, decoder_width=8)
"""Of the random release."""


@pytest.fixture(scope="session", params=FRAMES)
def built_for(request) -> tuple[Config, MessageSet]:
    config = vehicle(request.param)
    return config, message_set(config.bus)


def without(folder: dict[str, bytes], *names: str) -> dict[str, bytes]:
    return {name: text for name, text in folder.items() if name not in names}


@pytest.fixture(scope="session")
def exported(built_for, random_release) -> dict[str, bytes]:
    """The files that `export --c` writes, but for recorded rows."""
    config, _ = built_for
    program = random_program(1, model=MODEL, mpc=MpcConfig(horizon=8))
    windows = random_windows(program, 20)
    library = int8_library(program, windows) | ecu_sources() | {HEADER: ecu_settings(load(random_release), config)}
    played = {PLAYED: played_pressures(np.concatenate(windows), config)}
    return library | example_sources() | played | documents(library)


@pytest.fixture(scope="session")
def folder(exported) -> dict[str, bytes]:
    """The same flat and without documents: the tests' compiler takes no folders in folders."""
    taken = {name: text for name, text in exported.items() if name.endswith((".c", ".h", ".ld"))}
    return without({Path(name).name: text for name, text in taken.items()}, "replay.c")


@pytest.fixture(scope="session")
def image(folder, built_for, tmp_path_factory, shared_builds) -> Path:
    """`systick.c` for the board."""
    compiler = zig_compiler()
    if compiler is None:
        pytest.skip("ziglang (extra mcu) is not installed")
    path = tmp_path_factory.mktemp("systick") / "ecu.elf"
    contents = without(folder, "main_socketcan.c")
    shared_builds.compile_c(contents, path, compiler=compiler, flags=CORTEX_M7)
    return path


def emulated(image: Path, shift: int) -> tuple[int, list[bytes], dict[str, int]]:
    """Exit status, the JetCommands' bytes and the figures of a run with 2^shift ns an instruction."""
    command = [QEMU, "-M", "mps2-an500", "-nographic", "-monitor", "none", "-serial", "none"]
    command += ["-icount", f"shift={shift},sleep=off", "-semihosting-config", "enable=on,target=native"]
    command += ["-kernel", str(image)]
    done = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=300, check=False
    )
    assert "unexpected" not in done.stdout
    commands = [bytes.fromhex(data) for data in re.findall(r"^command (\w+)$", done.stdout, flags=re.MULTILINE)]
    figures = re.findall(r"^(?!command)(\w+) (\d+)$", done.stdout, flags=re.MULTILINE)
    return done.returncode, commands, {name: int(value) for name, value in figures}


needs_qemu = pytest.mark.skipif(not QEMU, reason="qemu-system-arm is not installed")


@pytest.mark.mcu
@needs_qemu
def test_under_systick_the_period_is_kept_and_the_jets_are_driven(image, built_for):
    config, messages = built_for
    status, data, figures = emulated(image, shift=1)
    # A step each period and none left out; only the first frame finds a stream that is not trusted yet.
    periods = len(data)
    assert (status, figures["steps"], figures["left_out"], figures["overruns"], figures["missed"]) == (
        0,
        periods,
        0,
        0,
        1,
    )
    window = ModelConfig().window
    assert figures["active"] == periods - window
    assert 0 < figures["longest_us"] < config.period_ns / 1000
    # On the other side of the bus: every command arrives and is understood, and says what the ECU did.
    receiver = E2eReceiver(messages.command.spec, config.bus.e2e)
    for period, wire in enumerate(data):
        reception = receiver.tick([Frame(frame_id=messages.command.spec.frame_id, data=wire)])
        assert reception.checks == (Check.OK,)
        command = messages.command.parse(wire)
        assert command is not None
        assert command.mode is expected_mode(period, window)
        assert command.enable == (period >= window)
        assert command.enable or command.flow_m2_per_s == 0
        counters = 16 if messages.command.spec.profile == 2 else 256
        assert command.pressure_counter == (period % counters if period > 0 else None)
    assert receiver.state.stream is StreamState.VALID
    last = messages.command.parse(data[-1])
    assert last is not None
    assert last.flow_m2_per_s != 0


def expected_mode(period: int, window: int) -> Mode:
    """The wish rises with period ASKED_FROM; the first frame, of a stream not trusted yet, leaves no row."""
    if period < ASKED_FROM:
        return Mode.OFF
    return Mode.WARMUP if period < window else Mode.CONTROL


@pytest.mark.mcu
@needs_qemu
def test_a_core_too_slow_for_the_period_is_noticed(image):
    """1 us an instruction: SysTick begins the next period before a step is done."""
    status, _, figures = emulated(image, shift=10)
    assert status != 0
    assert figures["left_out"] > 0
    assert figures["overruns"] > 0
    assert figures["longest_us"] > 20_000


LATER_AND_LATER = rb"""
/* In place of the ECU: each step ends some instructions nearer to SysTick's next interrupt, and a few behind it. */
#include "sw_ecu.h"

static uint32_t more;

void sw_ecu_init(sw_ecu *ecu) { (void)ecu; }

int sw_ecu_step(sw_ecu *ecu, int64_t now_ns, const sw_frame *frames_in, int count, sw_frame frames_out[SW_FRAMES_OUT])
{
    const volatile uint32_t *ticks_left = (const volatile uint32_t *)0xe000e018u;
    (void)ecu, (void)now_ns, (void)frames_in, (void)count;
    for (int i = 0; i < SW_FRAMES_OUT; i++) frames_out[i].length = 0;
    while (*ticks_left > 60u) {
    }
    for (uint32_t k = 0; k < more; k++) __asm__ volatile("nop");
    more = (more + 1u) % 700u;
    return SW_FRAMES_OUT;
}
"""
SHORT_PERIOD_NS, MANY_PERIODS = 40_000, 1500


@pytest.mark.mcu
@needs_qemu
def test_no_interrupt_is_slept_through_whenever_a_step_ends(folder, built_for, tmp_path, shared_builds):
    """One that came between the look at the period and the sleep would cost a whole period."""
    config, messages = built_for
    compiler = zig_compiler()
    if compiler is None:
        pytest.skip("ziglang (extra mcu) is not installed")
    period = f"#define SW_PERIOD_NS INT64_C({config.period_ns})".encode()
    assert period in folder[HEADER]
    length = messages.pressure.spec.length
    contents = {name: text for name, text in folder.items() if name.endswith((".h", ".ld"))} | {
        "systick.c": folder["systick.c"],
        "step.c": LATER_AND_LATER,
        HEADER: folder[HEADER].replace(period, f"#define SW_PERIOD_NS INT64_C({SHORT_PERIOD_NS})".encode()),
        "pressures.h": (
            f'#include "sw_ecu.h"\n#define PRESSURE_PERIODS {MANY_PERIODS}u\n'
            f"static const uint8_t pressures[PRESSURE_PERIODS][{length}];\n"
        ).encode(),
    }
    path = tmp_path / "ecu.elf"
    shared_builds.compile_c(contents, path, compiler=compiler, flags=CORTEX_M7)
    status, _, figures = emulated(path, shift=1)
    assert (status, figures["steps"], figures["left_out"]) == (0, MANY_PERIODS, 0)


BUS = rb"""
/* In place of a CAN interface: a socket that the test holds the other end of. Times of arrival are the kernel's. */
#include <stdlib.h>
#include <sys/socket.h>

int __wrap_socket(int domain, int type, int protocol);
int __wrap_bind(int fd, const struct sockaddr *address, socklen_t size);
int __wrap_ioctl(int fd, unsigned long request, ...);
int __wrap_setsockopt(int fd, int level, int name, const void *value, socklen_t size);
int __real_setsockopt(int fd, int level, int name, const void *value, socklen_t size);

int __wrap_socket(int domain, int type, int protocol)
{
    (void)domain, (void)type, (void)protocol;
    return atoi(getenv("BUS"));
}

int __wrap_bind(int fd, const struct sockaddr *address, socklen_t size)
{
    (void)fd, (void)address, (void)size;
    return 0;
}

int __wrap_ioctl(int fd, unsigned long request, ...)
{
    (void)fd, (void)request;
    return 0;
}

int __wrap_setsockopt(int fd, int level, int name, const void *value, socklen_t size)
{
    return level == SOL_SOCKET ? __real_setsockopt(fd, level, name, value, size) : 0;
}
"""
WRAPPED = ("-Wl,--wrap=socket", "-Wl,--wrap=bind", "-Wl,--wrap=ioctl", "-Wl,--wrap=setsockopt")
FD_FRAME, CLASSIC_FRAME = struct.Struct("=IB3x64s"), struct.Struct("=IB3x8s")
"""`struct canfd_frame` and `struct can_frame` of Linux."""
BUS_OFF = CLASSIC_FRAME.pack(0x20000000 | 0x40, 8, bytes(8))
"""An error frame: CAN_ERR_FLAG and CAN_ERR_BUSOFF of linux/can/error.h."""


@pytest.fixture(scope="session")
def linux_program(folder, tmp_path_factory, shared_builds) -> Callable[..., Path]:
    """`main_socketcan.c` with a bus in place of the kernel's, or without."""
    if not sys.platform.startswith("linux"):
        pytest.skip("SocketCAN is Linux's")
    contents = without(folder, "systick.c", "pressures.h", "mps2_an500.ld")
    place = tmp_path_factory.mktemp("socketcan")

    def build(name: str, *flags: str, **others: bytes) -> Path:
        path = place / name
        given = contents | {f"{other}.c": text for other, text in others.items()}
        shared_builds.compile_c(given, path, compiler=host_compiler(), flags=("-O1", "-ffp-contract=off", *flags))
        return path

    return build


def test_without_an_interface_the_linux_program_says_so(linux_program):
    program = linux_program("ecu")
    for arguments in ([], ["no_such_bus"]):
        done = subprocess.run([program, *arguments], capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 1
        assert done.stderr.startswith("usage: ecu INTERFACE: ")
        assert done.stderr.count("\n") == 1


class Vehicle:
    """The other end of the socket: sends pressures, hears commands, lets its wish fall and rise in a fault."""

    def __init__(self, bus: socket.socket, config: Config, messages: MessageSet) -> None:
        self._bus, self._config, self._messages = bus, config, messages
        self._sender = E2eSender(messages.pressure.spec)
        self._receiver = E2eReceiver(messages.command.spec, config.bus.e2e)
        self._wish, self._due = False, time.monotonic()
        self.commands: list[JetCommand] = []

    def until(self, holds: Callable[[JetCommand], bool], most_s: float = 60.0) -> None:
        """Live until a command is as wanted; a loaded computer may need more than one try."""
        end = time.monotonic() + most_s
        while not (self.commands and holds(self.commands[-1])):
            assert time.monotonic() < end, self.commands[-1:]
            pressure = Pressure(
                pressure_pa=(10.0, -20.0, 5.0, 0.0), valid=(True,) * 4, enable_request=self._wish, age_ns=0
            )
            frame = self._sender.frame(self._messages.pressure.emit(pressure), now_ns=0)
            form = FD_FRAME if frame.is_fd else CLASSIC_FRAME
            self._bus.send(form.pack(frame.frame_id, len(frame.data), frame.data))
            self._due += self._config.period_ns * 1e-9
            time.sleep(max(0.0, self._due - time.monotonic()))
            self.hear()
            if self.commands:
                # A fault ends with a wish that rises.
                self._wish = self.commands[-1].mode is not Mode.FAULT or len(self.commands) % 40 >= 20

    def hear(self) -> None:
        """Every frame that has come is one of ours, sound and in sequence."""
        spec, status = self._messages.command.spec, self._messages.status.spec
        for data in iter(self._received, b""):
            form = FD_FRAME if spec.is_fd else CLASSIC_FRAME
            identifier, length, content = form.unpack(data)
            assert (identifier, length) in {(spec.frame_id, spec.length), (status.frame_id, status.length)}
            if identifier == spec.frame_id:
                reception = self._receiver.tick([Frame(frame_id=identifier, data=content[:length])])
                assert reception.checks == (Check.OK,)
                command = self._messages.command.parse(content[:length])
                assert command is not None
                self.commands.append(command)

    def _received(self) -> bytes:
        try:
            return self._bus.recv(128)
        except BlockingIOError:
            return b""


@pytest.mark.processes
def test_the_linux_program_drives_the_jets_and_ends_with_them_shut(linux_program, built_for):
    config, messages = built_for
    program = linux_program("ecu_on_a_socket", *WRAPPED, bus=BUS)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    ours.setblocking(False)
    environment = os.environ | {"BUS": str(theirs.fileno())}
    lived = Vehicle(ours, config, messages)
    with (
        ours,
        theirs,
        subprocess.Popen(
            [program, "can0"], env=environment, pass_fds=[theirs.fileno()], stderr=subprocess.PIPE
        ) as running,
    ):
        try:
            lived.until(lambda command: command.mode is Mode.CONTROL and command.enable)
            ours.send(BUS_OFF)
            lived.until(lambda command: command.mode is Mode.FAULT)
            assert not lived.commands[-1].enable
            running.send_signal(signal.SIGTERM)
            assert running.wait(timeout=60) == 0
        finally:
            running.kill()
        lived.hear()
    last = lived.commands[-3:]
    assert [(command.mode, command.enable, command.flow_m2_per_s) for command in last] == [(Mode.OFF, False, 0.0)] * 3
    assert all(command.next_period == config.ecu.plan_ahead for command in lived.commands)


@pytest.mark.processes
def test_a_bus_that_takes_nothing_does_not_hold_the_linux_program_up(linux_program):
    """Nobody reads: after some frames a send would wait, and the program with it, even at its end."""
    program = linux_program("ecu_on_a_socket", *WRAPPED, bus=BUS)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    # So that few frames fill it.
    theirs.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)
    environment = os.environ | {"BUS": str(theirs.fileno())}
    with (
        ours,
        theirs,
        subprocess.Popen(
            [program, "can0"], env=environment, pass_fds=[theirs.fileno()], stderr=subprocess.PIPE
        ) as running,
    ):
        try:
            is_full(theirs)
            running.send_signal(signal.SIGTERM)
            assert running.wait(timeout=60) == 0
        finally:
            running.kill()


def is_full(bus: socket.socket, most_s: float = 60.0) -> None:
    """Return when this end takes nothing more."""
    poller, end = select.poll(), time.monotonic() + most_s
    poller.register(bus, select.POLLOUT)
    while poller.poll(0):
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.compiler
@pytest.mark.slow  # builds the folder as a stranger would
def test_the_lines_in_their_heads_and_cmake_build_them(exported, built_for, tmp_path):
    config, _ = built_for
    if config.bus.frames != "fd":
        pytest.skip("one of the sets shows it")
    write_folder(tmp_path / "c", exported)
    heads = [exported[f"examples/{name}.c"].decode().split("*/")[0] for name in ("main_socketcan", "systick")]
    lines = [re.sub(r"\\\n \*", "", head) for head in heads]
    builds = [re.findall(r"^ \*     (.*-o \S+)$", text, flags=re.MULTILINE) for text in lines]
    assert [len(found) for found in builds] == [1, 1]
    commands = [builds[0][0], *(["cmake -B build && cmake --build build"] if shutil.which("cmake") else [])]
    if zig_compiler() is not None:
        commands.append(builds[1][0].replace("python", sys.executable, 1))
    for command in commands:
        done = subprocess.run(command, shell=True, cwd=tmp_path / "c", capture_output=True, text=True, check=False)
        assert (done.returncode, "warning" in done.stderr) == (0, False), done.stderr
