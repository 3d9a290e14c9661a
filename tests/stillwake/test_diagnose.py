"""`stillwake diagnose`: the faults of an ECU as people and machines see them, and its description in a file."""

import json
import zipfile
from contextlib import contextmanager
from typing import Any

import pytest

pytest.importorskip("udsoncan")

from udsoncan.client import Client

from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import Nrc
from can_bridge.wire.messages import Reason
from stillwake.console.terminal import console
from tests.can_bridge.tester.line import Line
from tests.can_bridge.uds.scripted_ecu import Bench, ScriptedEcu
from tests.can_bridge.uds.test_faults import Memory

BUS = ("--bus", "socketcan:can7")


@pytest.fixture
def memory(monkeypatch) -> Memory:
    """Of the ECU on every bus."""
    made = Memory()
    ecu: Any = ScriptedEcu()

    @contextmanager
    def open_client(bus):
        ecu.server = UdsServer(ecu, Bench().key, bytes, faults=made.now)
        ecu.is_dead = ecu.is_reset = False
        with Client(Line(ecu)) as client:
            yield client

    pytest.importorskip("isotp")
    monkeypatch.setattr("can_bridge.tester.transport.open_client", open_client)
    monkeypatch.setattr("time.sleep", lambda seconds: None)
    return made


def test_faults_are_shown_and_cleared_while_the_jets_are_shut(cli, memory, tmp_path, monkeypatch):
    monkeypatch.setattr(console, "_width", 160)
    assert cli("diagnose", "faults", *BUS).out.strip() == "no faults"
    for reason in (Reason.STREAM_LOST, Reason.CLOCK):
        memory.note(reason)
    memory.power_on()
    memory.note(None)
    memory.power_on()
    memory.note(Reason.CLOCK)
    outcome = cli("diagnose", "faults", *BUS, "--json", tmp_path / "faults.json")
    assert outcome.code == 0
    rows = [line.split("  ") for line in outcome.out.splitlines()]
    texts = [" ".join("  ".join(row).split()) for row in rows if row[0].strip().startswith(("U", "P"))]
    moment = "65.5 s CONTROL 3 0 1.000 -0.500 0.000 0.250"
    assert texts == [
        f"U1101-87 no pressures came stored, age 1 {moment}",
        f"P1109-04 its clock jumped present {moment}",
    ]
    lost, clock = json.loads((tmp_path / "faults.json").read_text())["figures"]
    assert (lost["code"], lost["reason"], lost["age"], lost["time_ms"]) == ("U1101-87", "STREAM_LOST", 1, 65535)
    assert (clock["status"], clock["mode_before"]) == (0x2F, "CONTROL")
    memory.refusal = Nrc.CONDITIONS_NOT_CORRECT
    outcome = cli("diagnose", "faults", *BUS, "--clear")
    assert (outcome.code, "its jets are enabled" in outcome.err) == (5, True)
    memory.refusal = None
    assert "are cleared" in cli("diagnose", "faults", *BUS, "--clear").out
    assert cli("diagnose", "faults", *BUS).out.strip() == "no faults"


def test_the_description_is_written_whole_for_the_bus_of_the_settings(cli, tmp_path):
    outcome = cli("diagnose", "pdx", tmp_path / "ecu.pdx", "--set", "bus.frames=classic")
    assert (outcome.code, "classic frames" in outcome.out) == (0, True)
    with zipfile.ZipFile(tmp_path / "ecu.pdx") as archive:
        assert b"TX_DL = 8 (CAN)" in archive.read("stillwake.odx-d")
    assert cli("diagnose", "pdx", tmp_path).code == 1
