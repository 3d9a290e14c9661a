"""`stillwake ecu`: what it refuses, and the process from its start to its end on a bus with a vehicle."""

import json
import os
import signal
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from configparser import RawConfigParser
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from can_bridge.bus.backends.python_can import PythonCanBus
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from ecu.real_time.privileges import PRIORITY
from ecu.real_time.stage_times import EcuStage, load
from tests.conftest import STILLWAKE
from tests.ecu.daemon.driving import PATIENCE_S, Vehicle

ROOT = Path(__file__).parents[3]
GROUP = f"239.76.{os.getpid() >> 8 & 0xFF}.{os.getpid() & 0xFF}"
UDP = ("--set", "bus.interface=udp_multicast", "--set", f"bus.channel={GROUP}")


@pytest.mark.slow  # many calls
def test_what_cannot_run_is_one_line(all_refused: Callable[..., None], short_release: Path) -> None:
    all_refused("ecu", {"": "bus.interface = simulated: it runs in virtual time, without real devices"})
    all_refused(("ecu", *UDP), {"no-bundle": "no-bundle"})
    all_refused(
        ("ecu", short_release, *UDP),
        {
            "--set bus.interface=socketcan": "CAN bus socketcan '239.76.",
            "--set bus.interface=can4711": "python-can does not know it",
            "--set flow.control_period=0.1": "was built for another control period: 0.2, the vehicle has 0.1",
            "--set operating_point.speed=20": "was built for another operating point",
            "--set ecu.step_offset_ms=20": "ecu.step_offset_ms = 20: must be shorter than the control period",
            "--set ecu.compute_time_ms=5": "--set ecu.compute_time_ms: `ecu` does not use it",
            "--freshness x": "--freshness: needs a key",
            "--set bus.key=none": "none",
            "--metrics /proc/x": "cannot write /proc/x",
            "--frames x.blf": "x.blf: a measurement must end in .mf4 or .mcap",
            "--library .": "library .: ",
        },
    )


def test_the_examples_of_services_call_it_with_options_that_it_has(cli: Callable[..., Any]) -> None:
    known = cli("ecu", "--help").out
    for name, count in (("stillwake-ecu", 4), ("stillwake-ecu-slots", 5)):
        text = (ROOT / f"examples/systemd/{name}.service").read_text()
        unit = RawConfigParser(strict=False, comment_prefixes="#")
        unit.optionxform = str  # type: ignore[assignment,method-assign]  # names as they are
        unit.read_string(text.replace("\\\n", " "))
        service = unit["Service"]
        command = service["ExecStart"].split()
        assert command[1] == "ecu"
        options = [word for word in command if word.startswith("--")]
        assert len(options) == count, name
        assert all(option in known for option in options), name
        # What the daemon and its page rely on.
        assert (service["Type"], service["LimitRTPRIO"]) == ("notify", str(PRIORITY))
        assert "RestrictRealtime" not in service


@contextmanager
def systemd(path: Path, heard: list[str]) -> Iterator[None]:
    """Its end of the notify socket, read as it is: at once."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
        end.bind(str(path))

        def listen() -> None:
            while said := end.recv(4096).decode():
                heard.append(said)

        thread = threading.Thread(target=listen)
        thread.start()
        yield
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as enough:
            enough.sendto(b"", str(path))
        thread.join(PATIENCE_S)


@pytest.fixture
def vehicle() -> Iterator[Vehicle]:
    config = Config(bus=BusConfig(interface="udp_multicast", channel=GROUP))
    with PythonCanBus.open(config.bus) as bus:
        yield Vehicle(config, bus)


@pytest.mark.processes
def test_from_its_start_to_a_signal(vehicle: Vehicle, short_release: Path, tmp_path: Path) -> None:
    metrics, stages, log, heard = (*(tmp_path / name for name in ("ecu.prom", "ecu.npz", "log")), list[str]())
    environment = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "200000"}
    words = (str(short_release), *UDP, "--metrics", str(metrics), "--stage-times", str(stages), "--log", "json")
    with (
        systemd(tmp_path / "notify", heard),
        log.open("w") as stderr,
        subprocess.Popen(
            # More late steps than the window holds, of which a busy machine has many, never latch.
            [*STILLWAKE, "ecu", *words, "--set", "ecu.deadline_misses=11"],
            stderr=stderr,
            env=os.environ | environment,
            # Shells start background jobs deaf to Ctrl-C, and a test may run in one.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler) and None,
        ) as ecu,
    ):
        try:
            # The request stands when the ECU starts, and for as long as it takes: the jets stay shut.
            vehicle.until(lambda: len(vehicle.commands) > 30, request=True)
            assert {command.enable for command in vehicle.commands} == {False}
            vehicle.into_control()
            vehicle.until(metrics.exists)
            vehicle.until(lambda: vehicle.commands[-1].enable)
            ecu.send_signal(signal.SIGINT)
            vehicle.until(lambda: ecu.poll() is not None, request=True)
            # It was asked to run until stopped, and did.
            assert ecu.returncode == 0
            vehicle.period(request=True)
        finally:
            ecu.kill()
    assert [(c.enable, c.flow_m2_per_s) for c in vehicle.commands[-3:]] == [(False, 0.0)] * 3
    assert vehicle.action == 0.0
    assert any(said.startswith("READY=1") for said in heard)
    assert "WATCHDOG=1" in heard
    assert "STOPPING=1" in heard
    events = [json.loads(line) for line in log.read_text().splitlines()]
    assert (events[0]["event"], events[-1]["event"]) == ("runs", "stopped")
    assert events[0]["channel"] == GROUP
    assert {"OFF", "CONTROL"} <= {event["mode"] for event in events if event["event"] == "mode"}
    steps = events[-1]["steps"]
    assert f"stillwake_ecu_steps_total {steps}\n" in metrics.read_text()
    assert len(load(stages, EcuStage)) == steps
    # The socket is the test's; nothing half-written is left.
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ecu.npz", "ecu.prom", "log", "notify"]
