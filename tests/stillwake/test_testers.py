"""`stillwake calibrate` and `diagnose`: what they show and change, and each way to fail in one line; and the ECU's
description in files."""

import json
import zipfile
from contextlib import contextmanager
from dataclasses import replace

import pytest
from udsoncan.client import Client

from can_bridge.secoc.key import write_key
from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import Nrc
from can_bridge.wire.messages import Reason
from contract.controller.calibration import CALIBRATION_NAMES
from contract.shipped import BUNDLE
from stillwake.console.terminal import console
from tests.can_bridge.flashing.releases import provisioned
from tests.can_bridge.flashing.store_ecu import SECRET, StoreEcu
from tests.can_bridge.tester.ecus import OWN, Ecu
from tests.can_bridge.tester.line import Line
from tests.can_bridge.uds.scripted_ecu import Bench
from tests.can_bridge.uds.test_faults import Memory

BUS = ("--bus", "socketcan:can7")


@pytest.fixture
def on_every_bus(monkeypatch):
    """Let an ECU answer on every bus; `asked` is called before, with the bus."""

    def answers(ecu, asked) -> None:
        @contextmanager
        def open_client(bus):
            asked(bus)
            with Client(Line(ecu)) as client:
                yield client

        monkeypatch.setattr("can_bridge.tester.transport.open_client", open_client)
        monkeypatch.setattr("time.sleep", lambda seconds: None)

    return answers


@pytest.fixture
def ecu(on_every_bus) -> Ecu:
    made = Ecu()
    on_every_bus(made, lambda bus: made.buses.append((bus.interface, bus.channel, bus.frames)))
    return made


@pytest.fixture
def memory(on_every_bus) -> Memory:
    """Of the ECU whose faults are shown."""
    made, flash = Memory(), provisioned()
    ecu = StoreEcu(lambda: flash)
    on_every_bus(ecu, lambda _: setattr(ecu, "server", UdsServer(ecu.services, Bench().key, bytes, faults=made.now)))
    return made


@pytest.fixture
def key(tmp_path):
    write_key(tmp_path / "ecu.key", SECRET)
    return ("--access", tmp_path / "ecu.key")


def cells(out: str, name: str) -> list[str]:
    return next(line.split() for line in out.splitlines() if line.split()[:1] == [name])[1:]


def test_values_are_shown_without_a_key_and_changed_with_it(printed, ecu, key, tmp_path):
    out = printed("calibrate", *BUS, "--set", "bus.frames=classic")
    assert cells(out, "lift") == ["0.01", "0", "10", "0.01"]
    assert cells(out, "action_limit") == ["0.07", "0.01", "0.07", "0.07"]
    assert "nothing is stored" in out
    assert ecu.buses == [("socketcan", "can7", "classic")]
    figures = tmp_path / "figures.json"
    out = printed("calibrate", *BUS, *key, "lift=0.5", "delay_steps=2", "--json", figures)
    assert cells(out, "lift") == ["0.01", "0.5", "0", "10", "0.01"]
    assert cells(out, "effort") == ["0", "0", "0", "10", "0"]
    in_force = ecu.segment.take()
    assert (in_force.weights.lift, in_force.delay_steps) == (0.5, 2)
    written = json.loads(figures.read_text())["figures"]
    assert list(written["after"]) == list(CALIBRATION_NAMES)
    assert (written["before"]["lift"], written["after"]["lift"]) == (pytest.approx(0.01), 0.5)
    assert written["stored"] is False


def test_stored_and_reverted(printed, ecu, key):
    assert "a calibration is stored" in printed("calibrate", *BUS, *key, "lift=0.5", "--store")
    ecu.power_on()
    assert ecu.segment.in_force.weights.lift == 0.5
    # What is in force is stored without values.
    ecu.segment.set(replace(OWN, delay_steps=1))
    printed("calibrate", *BUS, *key, "--store")
    ecu.power_on()
    assert ecu.segment.in_force.delay_steps == 1
    out = printed("calibrate", *BUS, *key, "--revert")
    assert "nothing is stored" in out
    assert cells(out, "delay_steps")[:2] == ["1", "0"]
    assert ecu.segment.in_force == OWN


def test_what_makes_no_sense_is_one_line_and_changes_nothing(all_refused, ecu, key):
    rows = {
        "lift": "'lift': must be NAME=VALUE with a name of drag_mean",
        "lift=high": "'high' must be a number",
        "lift=1 lift=2": "lift is given twice",
        "drag=1": "'drag=1': must be NAME=VALUE with a name of drag_mean",
        "--revert --store": "--revert discards",
        "--revert lift=1": "--revert discards",
        "lift=11": "lift = 11: must be in 0..10",
        "--set ecu.delay_steps=1": "`calibrate` does not use it",
    }
    all_refused(("calibrate", *BUS, *key), rows)
    assert ecu.segment.take() is None
    ecu.buses.clear()
    all_refused(("calibrate", *BUS), dict.fromkeys(("lift=1", "--store", "--revert"), "--access: name the file"))
    all_refused("calibrate", {"--bus can0": "INTERFACE:CHANNEL"})
    assert ecu.buses == []


def test_each_failure_of_the_ecu_has_its_status(refused, ecu, key, tmp_path):
    ecu.jets = True
    assert "its jets are enabled" in refused("calibrate", *BUS, *key, "lift=1", "--store", status=5)
    write_key(tmp_path / "other.key", bytes(range(2, 18)))
    other = ("--access", tmp_path / "other.key")
    assert "refused the key" in refused("calibrate", *BUS, *other, "lift=1", status=4)
    ecu.has_release = False
    ecu.power_on()
    assert "no release runs in it" in refused("calibrate", *BUS)


def test_faults_are_shown_and_cleared_while_the_jets_are_shut(cli, printed, memory, tmp_path, monkeypatch):
    monkeypatch.setattr(console, "_width", 160)
    assert printed("diagnose", *BUS).endswith("no faults\n")
    for reason in (Reason.STREAM_LOST, Reason.CLOCK):
        memory.note(reason)
    memory.power_on()
    memory.note(None)
    memory.power_on()
    memory.note(Reason.CLOCK)
    out = printed("diagnose", *BUS, "--json", tmp_path / "faults.json")
    assert "serial number" in out and "0815" in out and "20 ms" in out
    rows = [line.split("  ") for line in out.splitlines()]
    texts = [" ".join("  ".join(row).split()) for row in rows if row[0].strip().startswith(("U", "P"))]
    moment = "65.5 s CONTROL 3 0 1.000 -0.500 0.000 0.250"
    assert texts == [
        f"U1101-87 no pressures arrived stored, age 1 {moment}",
        f"P1109-04 its clock jumped present {moment}",
    ]
    figures = json.loads((tmp_path / "faults.json").read_text())["figures"]
    lost, clock = figures["faults"]
    assert (figures["serial_number"], figures["store"]["key_list_version"]) == ("0815", 1)
    assert (lost["code"], lost["reason"], lost["age"], lost["time_ms"]) == ("U1101-87", "STREAM_LOST", 1, 65535)
    assert (clock["status"], clock["mode_before"]) == (0x2F, "CONTROL")
    memory.refusal = Nrc.CONDITIONS_NOT_CORRECT
    outcome = cli("diagnose", *BUS, "--clear")
    assert (outcome.code, "its jets are enabled" in outcome.err) == (5, True)
    memory.refusal = None
    assert "are cleared" in printed("diagnose", *BUS, "--clear")
    assert printed("diagnose", *BUS).endswith("no faults\n")


def test_the_descriptions_are_written_for_the_bus_and_the_vehicle_of_the_settings(printed, refused, tmp_path):
    made = ("export", "--for-testers", tmp_path / "truck")
    printed(*made, "--set", "bus.frames=classic", "--set", "ecu.command_step=0.03")
    with zipfile.ZipFile(tmp_path / "truck" / "stillwake.pdx") as archive:
        assert b"TX_DL = 8 (CAN)" in archive.read("stillwake.odx-d")
    text = (tmp_path / "truck" / "stillwake.a2l").read_text()
    assert "Calibration of release truck-wake" in text
    line = next(line for line in text.splitlines() if "CHARACTERISTIC command_step" in line)
    assert float(text[text.index(line) :].splitlines()[1].split()[-1]) == pytest.approx(0.03)
    assert "give --overwrite" in refused(*made)
    other = ("export", BUNDLE, "--for-testers", tmp_path / "other")
    assert "action limit" in refused(*other, "--set", "flow.action_limit=0.05")
    assert "`export` does not use it" in refused(*other, "--set", "mpc.horizon=3")
    printed(*other)
