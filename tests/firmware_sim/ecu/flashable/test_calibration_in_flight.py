"""The goal of an ECU that controls, changed by diagnosis: when it acts, what outlives power, and whose it is."""

import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from can_bridge.flashing.access_level import Level
from can_bridge.wire.messages import Mode
from contract.controller.calibration import NAMES
from tests.firmware_sim.conftest import RecordingController
from tests.firmware_sim.ecu.flashable.vehicle_ecu import Rig, image, provision, shipped

VALUES = struct.Struct("<9fI")
READ, READ_STORED = b"\x22\xfd\x10", b"\x22\xfd\x12"
WRITE, STORE, DROP = b"\x2e\xfd\x10", b"\x2e\xfd\x12\x01", b"\x2e\xfd\x12\x00"
LIMIT = 0.075


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    """Of an ECU that always wants the jets full on."""
    provision(tmp_path / "ecu", image("first"))
    return Rig(tmp_path / "ecu", controller_of=lambda bundle: RecordingController(lambda i: 2 * LIMIT))


def values(rig: Rig) -> dict[str, float]:
    return dict(zip(NAMES, VALUES.unpack(rig.good(READ)[3:]), strict=True))


def write(rig: Rig, **changes: float) -> None:
    *floats, delay_steps = {**values(rig), **changes}.values()
    rig.good(WRITE + VALUES.pack(*floats, int(delay_steps)))


def calibrating(rig: Rig) -> None:
    rig.good(b"\x10\x03")
    rig.unlock(Level.CALIBRATION)


def until(rig: Rig, holds: Callable[[], bool]) -> None:
    for _ in range(5000):
        if holds():
            return
        rig.millisecond()
    raise AssertionError("it never came to that")


def into_control(rig: Rig) -> None:
    rig.request = False
    rig.run(100)
    rig.request = True
    until(rig, lambda: rig.commands[-1].mode is Mode.CONTROL)
    rig.run(60)


def actions(rig: Rig) -> list[float]:
    scale = rig.config.operating_point.flow_rate_scale
    return [abs(command.flow_m2_per_s) / scale for command in rig.commands]


def test_the_jets_keep_a_narrower_limit_from_the_next_period_on(rig: Rig) -> None:
    calibrating(rig)
    into_control(rig)
    assert actions(rig)[-1] == pytest.approx(LIMIT, rel=1e-3)
    write(rig, action_limit=LIMIT / 2, lift=0.5)
    before = len(rig.commands)
    rig.run(200)
    assert all(0.0 < action <= LIMIT / 2 for action in actions(rig)[before:])
    assert actions(rig)[-1] == pytest.approx(LIMIT / 2, rel=1e-3)
    assert {command.mode for command in rig.commands[before:]} == {Mode.CONTROL}
    rig.good(DROP)
    rig.run(100)
    assert actions(rig)[-1] == pytest.approx(LIMIT, rel=1e-3)


def test_nothing_wider_and_nothing_without_the_key(rig: Rig) -> None:
    rig.good(b"\x10\x03")
    own = rig.good(READ)[3:]
    assert rig.ask(WRITE + own) == b"\x7f\x2e\x33"
    rig.unlock(Level.CALIBRATION)
    wide = VALUES.pack(*(0.0,) * 7, 0.0751, LIMIT, 0)
    assert rig.ask(WRITE + wide) == b"\x7f\x2e\x31"
    assert rig.good(READ)[3:] == own


def test_it_is_stored_with_the_jets_shut_and_kept_with_its_release(rig: Rig) -> None:
    own = shipped().manifest.mpc.weights.lift
    calibrating(rig)
    into_control(rig)
    write(rig, lift=0.5)
    assert rig.ask(STORE) == b"\x7f\x2e\x22"
    rig.request = False
    rig.run(1200)
    rig.good(STORE)
    rig.power_on()
    assert values(rig)["lift"] == 0.5
    assert rig.good(READ_STORED)[3:] == b"\x01"
    # Another release has its own; the one before finds its calibration again.
    rig.start(image("second"))
    assert values(rig)["lift"] == pytest.approx(own)
    assert rig.good(READ_STORED)[3:] == b"\x00"
    rig.programming()
    rig.good(b"\x31\x01\x02\x07")
    rig.reset()
    assert values(rig)["lift"] == 0.5
    calibrating(rig)
    rig.good(DROP)
    rig.power_on()
    assert values(rig)["lift"] == pytest.approx(own)


def test_one_that_the_vehicle_no_longer_allows_is_told_and_not_used(rig: Rig) -> None:
    calibrating(rig)
    write(rig, command_step=0.07)
    rig.good(STORE)
    rig.config = replace(rig.config, ecu=replace(rig.config.ecu, command_step=0.05))
    rig.power_on()
    assert values(rig)["command_step"] == pytest.approx(0.05)
    assert "calibration_dropped" in rig.told.names()
