"""An ECU that can be flashed, as a process: provisioned, run, flashed, killed amid a transfer, flashed again."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from can_bridge.bus.backends.python_can import PythonCanBus
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.shipped import BUNDLE
from tests.firmware_sim.ecu.daemon.driving import PATIENCE_S, Vehicle
from tests.stillwake.commands.ecu_process import Process, process

GROUP = f"239.77.{os.getpid() >> 8 & 0xFF}.{os.getpid() & 0xFF}"
BUS = ("--bus", f"udp_multicast:{GROUP}")
SET_BUS = ("--set", "bus.interface=udp_multicast", "--set", f"bus.channel={GROUP}")


@dataclass
class Works:
    """A maker's keys, two releases, and an ECU's folder."""

    folder: Path
    cli: Callable[..., Any]
    base: Path

    def path(self, name: str) -> str:
        return str(self.folder / name)

    def good(self, *arguments: str) -> str:
        outcome = self.cli(*arguments)
        assert outcome.code == 0, outcome.err
        return str(outcome.out)

    def release(self, name: str, version: int) -> str:
        key = ("--key", self.path("maker/release.key"))
        self.good(
            *("bundle", "renew", str(self.base), self.path(name), "--name", name, *key),
            *("--security-version", str(version)),
        )
        return self.path(name)

    def provision_words(self) -> tuple[str, ...]:
        given = ("--root", self.path("root/release.pub"), "--keys", self.path("keys.list"), "--hardware", "bench")
        return ("ecu", "provision", self.path("ecu"), *given, "--serial", "42")


@pytest.fixture
def works(tmp_path: Path, cli: Callable[..., Any], short_release: Path) -> Works:
    works = Works(tmp_path, cli, short_release)
    works.good("bundle", "keygen", works.path("root"))
    works.good("bundle", "keygen", works.path("maker"))
    works.good("can", "keygen", works.path("access.key"))
    signs = ("--key", works.path("maker/release.pub"))
    root = ("--root", works.path("root/release.key"))
    works.good("bundle", "keylist", works.path("keys.list"), *root, "--version", "1", *signs)
    works.release("first", 1)
    return works


@contextmanager
def ecu(works: Works, *more: str) -> Iterator[Process]:
    with process("--slots", works.path("ecu"), *SET_BUS, "--access", works.path("access.key"), *more) as its:
        its.until("runs")
        yield its


def flash(works: Works, release: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "stillwake", "flash", release, *BUS, "--access", works.path("access.key")]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def test_it_is_provisioned_once_and_shown(works: Works, refused: Callable[..., str]) -> None:
    unknown = ("--bundle", str(BUNDLE))
    assert "a key that this ECU does not know" in refused(*works.provision_words(), *unknown)
    assert "ECU 42 (bench)" in works.good(*works.provision_words(), "--bundle", works.path("first"))
    assert "is there already" in refused(*works.provision_words())
    info = works.good("ecu", "info", "--slots", works.path("ecu"))
    # What runs, the folder cannot know: it must not claim that nothing does.
    assert "confirmed, first" in info and "asks the ECU" in info
    shown = json.loads(works.good("ecu", "info", "--slots", works.path("ecu"), "--json"))
    assert (shown["hardware"], shown["serial_number"]) == ("bench", "42")
    assert shown["store"]["slots"][0]["phase"] == "CONFIRMED"
    assert shown["store"]["key_list_version"] == 1


def test_what_cannot_run_is_one_line(works: Works, all_refused: Callable[..., None]) -> None:
    works.good(*works.provision_words())
    slots = "--slots ecu --access access.key"
    all_refused(
        ("ecu", *SET_BUS),
        {
            "--slots ecu": "--slots: needs --access KEYFILE",
            "--access access.key": "--access: goes with --slots",
            "--hardware x": "--hardware: goes with --slots",
            "--slots none --access access.key": "none: no folder of an ECU",
            "--slots ecu --access none.key": "none.key",
            f"first {slots}": "BUNDLE: --slots runs the release in its folder",
            f"{slots} --trust x": "--trust: --slots runs",
            f"{slots} --set mpc.weights.lift=0.1": "does not use it",
        },
    )


@pytest.mark.proofs  # six processes; `tests/stillwake/test_flash_pages.py` flashes one in `make test`
@pytest.mark.processes
def test_flashed_killed_amid_a_transfer_and_flashed_again(works: Works) -> None:
    pytest.importorskip("udsoncan")
    works.good(*works.provision_words(), "--bundle", works.path("first"))
    second = works.release("second", 2)
    config = Config(bus=BusConfig(interface="udp_multicast", channel=GROUP))
    with ecu(works) as first:
        assert first.until("booted")["release"] == "first"
        tester = flash(works, second)
        first.until("update")
        # Some blocks on its way.
        record = Path(works.path("ecu")) / "slot_b.image"
        begin = time.monotonic()
        while record.stat().st_size < 20_000:
            assert time.monotonic() - begin < PATIENCE_S
            time.sleep(0.001)
        first.popen.send_signal(signal.SIGKILL)
        first.popen.wait(PATIENCE_S)
        tester.terminate()
        tester.communicate(timeout=PATIENCE_S)
    with ecu(works, "--periods", "1000000") as again:
        assert again.until("booted")["release"] == "first"
        shown = works.good("ecu", "info", *BUS)
        assert "filling" in shown
        tester = flash(works, second)
        said, _ = tester.communicate(timeout=PATIENCE_S)
        assert tester.returncode == 0, said
        assert "second runs, and is confirmed" in said
        names = again.names()
        order = ["booted", "update", "checked", "activated", "trial", "self_test", "confirmed"]
        assert [name for name in names if name in order] == order
        # The control is there all along, and the new release does it.
        with PythonCanBus.open(config.bus) as bus:
            vehicle = Vehicle(config, bus)
            vehicle.until(lambda: len(vehicle.statuses) > 10, request=False)
            assert vehicle.statuses[-1].bundle_hash == int(again.until("trial")["digest"][:8], 16)
        # A stop before the stated periods are over.
        assert again.ends(signal.SIGTERM) == 143
    assert again.other == ["stopped\n"]
    shown = json.loads(works.good("ecu", "info", "--slots", works.path("ecu"), "--json"))
    assert {slot["phase"] for slot in shown["store"]["slots"]} == {"CONFIRMED"}
    assert shown["store"]["least_security_version"] == 2
