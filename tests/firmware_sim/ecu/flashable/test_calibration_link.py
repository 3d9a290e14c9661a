"""Calibration on the ECU: by UDS and XCP the same values, from the next period on, and for one release alone."""

from dataclasses import replace
from pathlib import Path

import pytest

from can_bridge.calibration.xcp import COMMAND_ID, RESPONSE_ID
from can_bridge.flashing.access_level import Level
from can_bridge.wire.frame import Frame
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig, SensorCheckConfig
from contract.controller.calibration import Calibration
from tests.firmware_sim.conftest import RecordingController
from tests.firmware_sim.ecu.flashable.vehicle_ecu import CONFIRM_ROUTINE, Rig, image, provision

CONFIG = Config(ecu=EcuConfig(sensor_check=SensorCheckConfig(enabled=False), plan_ahead=False))
READ, WRITE, STORE = b"\x22\xfd\x10", b"\x2e\xfd\x10", b"\x2e\xfd\x12\x01"


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    provision(tmp_path / "ecu", image("first"))
    # It wants more than there is: what goes out is the limit.
    return Rig(tmp_path / "ecu", CONFIG, controller_of=lambda bundle: RecordingController(lambda i: 1.0))


def in_force(rig: Rig) -> Calibration:
    return Calibration.unpack(rig.good(READ)[3:])


def unlocked(rig: Rig) -> None:
    rig.good(b"\x10\x03")
    rig.unlock(Level.CALIBRATION)


def narrowed(rig: Rig) -> Calibration:
    own = in_force(rig)
    return replace(own, action_limit=own.action_limit / 2).as_kept()


def test_half_the_limit_is_half_the_command_from_one_period_on(rig: Rig) -> None:
    rig.request = False
    rig.run(100)
    rig.request = True
    rig.run(2000)
    full = rig.commands[-1].flow_m2_per_s
    assert full > 0.0
    values = narrowed(rig)
    unlocked(rig)
    before = len(rig.commands)
    rig.good(WRITE + values.pack())
    rig.run(40)
    flows = [command.flow_m2_per_s for command in rig.commands[before - 1 :]]
    assert set(flows) == {full, flows[-1]}
    assert flows[-1] == pytest.approx(full / 2, rel=1e-3)
    # Stored it is not while the jets may run: a slow memory must not come into a control period.
    assert rig.ask(STORE)[2] == 0x22


def test_what_is_stored_is_in_force_after_power_on_and_for_its_release_alone(rig: Rig) -> None:
    own, values = in_force(rig), narrowed(rig)
    unlocked(rig)
    rig.good(WRITE + values.pack())
    rig.power_on()
    assert in_force(rig) == own
    unlocked(rig)
    rig.good(WRITE + values.pack())
    rig.good(STORE)
    rig.power_on()
    assert in_force(rig) == values
    rig.start(image("second"))
    assert in_force(rig) == own
    rig.programming()
    rig.good(CONFIRM_ROUTINE)
    rig.power_on()
    assert in_force(rig) == own


def test_a_tool_reads_by_xcp_what_uds_has_written(rig: Rig) -> None:
    values = narrowed(rig)
    unlocked(rig)
    rig.good(WRITE + values.pack())

    def asked(packet: bytes) -> bytes:
        frame = Frame(frame_id=COMMAND_ID, data=packet)
        (answer,) = [f for f in rig.ecu.step(rig.now_ns, [frame]) if f.frame_id == RESPONSE_ID]
        rig.now_ns += CONFIG.period_ns
        return answer.data

    assert asked(b"\xff\x00")[0] == 0xFF
    # SET_MTA to the segment, UPLOAD 4 bytes at a time.
    assert asked(b"\xf6\x00\x00\x00" + (0x2000_0000).to_bytes(4, "little"))[0] == 0xFF
    raw = b"".join(asked(b"\xf5\x04")[1:5] for _ in range(len(values.pack()) // 4))
    assert raw == values.pack()
    # A write needs the key.
    assert asked(b"\xf0\x04" + bytes(4))[0] == 0xFE


def test_a_stored_calibration_that_the_vehicle_no_longer_allows_is_told_and_not_used(rig: Rig) -> None:
    own = in_force(rig)
    unlocked(rig)
    rig.good(WRITE + replace(own, delay_steps=own.delay_steps + 1).pack())
    rig.good(STORE)
    rig.ecu.store.keep_calibration(replace(own, action_limit=10.0).pack())
    rig.power_on()
    assert "calibration_dropped" in rig.told.names()
    assert in_force(rig) == own
