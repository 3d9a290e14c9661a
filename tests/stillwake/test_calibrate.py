"""`stillwake calibrate`: what it shows, what it changes, and each way to fail in one line."""

import json
from contextlib import contextmanager
from dataclasses import replace

import pytest
from udsoncan.client import Client

from can_bridge.secoc.key import write_key
from contract.controller.calibration import CALIBRATION_NAMES
from tests.can_bridge.flashing.store_ecu import SECRET
from tests.can_bridge.tester.calibrated_ecu import OWN, Ecu
from tests.can_bridge.tester.line import Line

BUS = ("--bus", "socketcan:can7")


@pytest.fixture
def ecu(monkeypatch) -> Ecu:
    """On every bus."""
    made = Ecu()

    @contextmanager
    def open_client(bus):
        made.buses.append((bus.interface, bus.channel, bus.frames))
        with Client(Line(made)) as client:
            yield client

    monkeypatch.setattr("can_bridge.tester.transport.open_client", open_client)
    monkeypatch.setattr("time.sleep", lambda seconds: None)
    return made


@pytest.fixture
def key(tmp_path):
    write_key(tmp_path / "ecu.key", SECRET)
    return ("--access", tmp_path / "ecu.key")


def cells(out: str, name: str) -> list[str]:
    return next(line.split() for line in out.splitlines() if line.split()[:1] == [name])[1:]


def test_without_values_it_shows_them_and_needs_no_key(cli, ecu):
    outcome = cli("calibrate", *BUS, "--set", "bus.frames=classic")
    assert outcome.code == 0
    assert cells(outcome.out, "lift") == ["0.01", "0", "10", "0.01"]
    assert cells(outcome.out, "action_limit") == ["0.07", "0.01", "0.07", "0.07"]
    assert "nothing is stored" in outcome.out
    assert ecu.buses == [("socketcan", "can7", "classic")]


def test_values_are_changed_and_shown_before_and_after(cli, ecu, key, tmp_path):
    figures = tmp_path / "figures.json"
    outcome = cli("calibrate", *BUS, *key, "lift=0.5", "delay_steps=2", "--json", figures)
    assert outcome.code == 0
    assert cells(outcome.out, "lift") == ["0.01", "0.5", "0", "10", "0.01"]
    assert cells(outcome.out, "effort") == ["0", "0", "0", "10", "0"]
    in_force = ecu.segment.take()
    assert (in_force.weights.lift, in_force.delay_steps) == (0.5, 2)
    written = json.loads(figures.read_text())["figures"]
    assert list(written["after"]) == list(CALIBRATION_NAMES)
    assert (written["before"]["lift"], written["after"]["lift"]) == (pytest.approx(0.01), 0.5)
    assert written["stored"] is False


def test_stored_and_reverted(cli, ecu, key):
    outcome = cli("calibrate", *BUS, *key, "lift=0.5", "--store")
    assert (outcome.code, "a calibration is stored" in outcome.out) == (0, True)
    ecu.power_on()
    assert ecu.segment.in_force.weights.lift == 0.5
    # What is in force is stored without values.
    ecu.segment.set(replace(OWN, delay_steps=1))
    assert cli("calibrate", *BUS, *key, "--store").code == 0
    ecu.power_on()
    assert ecu.segment.in_force.delay_steps == 1
    outcome = cli("calibrate", *BUS, *key, "--revert")
    assert (outcome.code, "nothing is stored" in outcome.out) == (0, True)
    assert cells(outcome.out, "delay_steps")[:2] == ["1", "0"]
    assert ecu.segment.in_force == OWN


def test_what_makes_no_sense_is_one_line_and_changes_nothing(all_refused, ecu, key):
    all_refused(
        ("calibrate", *BUS, *key),
        {
            "lift": "'lift': must be NAME=VALUE with a name of drag_mean",
            "lift=high": "'high' must be a number",
            "lift=1 lift=2": "lift is given twice",
            "drag=1": "'drag=1': must be NAME=VALUE with a name of drag_mean",
            "--revert --store": "--revert: discards",
            "--revert lift=1": "--revert: discards",
            "lift=11": "lift = 11: must be in 0..10",
            "--set ecu.delay_steps=1": "`calibrate` does not use it",
        },
    )
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
    assert "no release runs in it" in refused("calibrate", *BUS)
