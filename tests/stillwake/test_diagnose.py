"""`stillwake diagnose`: an ECU and its faults as people and machines see them; and its description in files."""

import json
import zipfile
from contextlib import contextmanager

import pytest

pytest.importorskip("udsoncan")

from udsoncan.client import Client

from can_bridge.uds.server import UdsServer
from can_bridge.uds.services import Nrc
from can_bridge.wire.messages import Reason
from contract.shipped import BUNDLE
from stillwake.console.terminal import console
from tests.can_bridge.flashing.releases import provisioned
from tests.can_bridge.flashing.store_ecu import StoreEcu
from tests.can_bridge.tester.line import Line
from tests.can_bridge.uds.scripted_ecu import Bench
from tests.can_bridge.uds.test_faults import Memory

BUS = ("--bus", "socketcan:can7")


@pytest.fixture
def memory(monkeypatch) -> Memory:
    """Of the ECU on every bus."""
    made = Memory()
    flash = provisioned()
    ecu = StoreEcu(lambda: flash)

    @contextmanager
    def open_client(bus):
        ecu.server = UdsServer(ecu.services, Bench().key, bytes, faults=made.now)
        with Client(Line(ecu)) as client:
            yield client

    pytest.importorskip("isotp")
    monkeypatch.setattr("can_bridge.tester.transport.open_client", open_client)
    monkeypatch.setattr("time.sleep", lambda seconds: None)
    return made


def test_faults_are_shown_and_cleared_while_the_jets_are_shut(cli, memory, tmp_path, monkeypatch):
    monkeypatch.setattr(console, "_width", 160)
    assert cli("diagnose", *BUS).out.endswith("no faults\n")
    for reason in (Reason.STREAM_LOST, Reason.CLOCK):
        memory.note(reason)
    memory.power_on()
    memory.note(None)
    memory.power_on()
    memory.note(Reason.CLOCK)
    outcome = cli("diagnose", *BUS, "--json", tmp_path / "faults.json")
    assert outcome.code == 0
    assert "serial number" in outcome.out and "0815" in outcome.out and "20 ms" in outcome.out
    rows = [line.split("  ") for line in outcome.out.splitlines()]
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
    assert "are cleared" in cli("diagnose", *BUS, "--clear").out
    assert cli("diagnose", *BUS).out.endswith("no faults\n")


def test_the_descriptions_are_written_for_the_bus_and_the_vehicle_of_the_settings(cli, refused, tmp_path):
    made = ("export", "--for-testers", tmp_path / "truck")
    outcome = cli(*made, "--set", "bus.frames=classic", "--set", "ecu.command_step=0.03")
    assert (outcome.code, outcome.err) == (0, "")
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
    assert cli(*other).code == 0
