"""`stillwake vehicle`: what it refuses, what it says, and how it ends."""

import json
from pathlib import Path

import can
import pytest

from stillwake.parts.releases import open_release

VIRTUAL = ("--set", "bus.interface=virtual", "--set", "bus.channel=test-stillwake-vehicle")


@pytest.mark.slow
def test_what_cannot_be_is_one_line(all_refused) -> None:
    rows = {
        "--set bus.interface=simulated": "bus.interface = simulated: it runs in virtual time, without real",
        "--plant wake --episode x": "--episode x: does not go with --plant wake",
        "--state x.npz": "--state x.npz: needs --plant wake: a recording cannot be changed",
        "--drive ramps": "--drive ramps: needs --plant wake: a recording cannot be changed",
        "--episode sine": "the data set has no episode 'sine', only ",
        "--bundle none": "none",
        "--freshness x.json": "--freshness x.json: needs a key, but bus.key is empty",
        "--freshness x.json --json x.json": "x.json is the same path as x.json, or lies in it",
        "--set mpc.horizon=3": "`vehicle` does not use it",
        "--stage-times /proc/nowhere/x.npz": "/proc/nowhere",
        "--set bus.interface=socketcan": "CAN bus socketcan 'test-stillwake-vehicle': ",
    }
    all_refused(("vehicle", "--periods", "3", *VIRTUAL), rows)


@pytest.mark.slow  # waits for an ECU
def test_without_an_ecu_the_status_says_so_and_the_figures_are_written(cli, tmp_path: Path) -> None:
    frames = tmp_path / "f.mf4"
    words = ("--priority", "0", "--periods", "5", "--json", tmp_path / "f.json", "--frames", frames)
    slower = ("--set", "operating_point.speed=12.5", "--set", "flow.control_period=0.4")
    outcome = cli("vehicle", *VIRTUAL, *words, *slower)
    assert outcome.code == 3
    said = " ".join(outcome.out.split())
    assert "recorded (open loop)" in said
    assert "is for a control period of 0.2 t_c, these settings have 0.4 t_c" in said
    assert "vehicle at 12.5 m/s, control period 80 ms, on virtual test-stillwake-vehicle" in said
    assert "the pressures do not respond to the jets" in said
    assert f"warning: bundle {open_release(None).manifest.name} is for 2.5 m, 25 m/s" in said
    assert "bundle renew ... --set operating_point.speed=12.5" in said
    assert "done: the request for control is withdrawn" in said
    found = json.loads((tmp_path / "f.json").read_text(encoding="utf-8"))
    assert (found["figures"]["periods"], found["figures"]["commands"]) == (5, 0)
    assert found["figures"]["age_p50_ms"] is None
    assert found["facts"]["config"]["bus"]["interface"] == "virtual"
    with can.MF4Reader(frames) as read:
        sent = [(one.arbitration_id, one.is_rx) for one in read]
    assert set(sent) == {(0x120, False), (0x128, False)}
    # Five periods, and three that withdraw the request.
    assert sent.count((0x128, False)) == 8
