"""The goal of a running ECU, changed by diagnosis and XCP: when it acts, what outlives power, and for which release."""

import struct
from dataclasses import replace
from pathlib import Path

import pytest

from can_bridge.calibration.segment import ADDRESS
from can_bridge.flashing.backing import MediumError
from can_bridge.flashing.state import Level
from can_bridge.flashing.store import Store
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Mode
from contract.controller.calibration import CALIBRATION_NAMES
from tests.can_bridge.flashing.store_ecu import KEY
from tests.can_bridge.uds.addresses import COMMAND_ID, XCP_RESPONSE_ID
from tests.ecu.conftest import RecordingController
from tests.ecu.flashable.vehicle_ecu import UNCHECKED, Rig, image, provision, shipped

VALUES = struct.Struct("<10fI")
READ, READ_STORED = b"\x22\xfd\x10", b"\x22\xfd\x12"
WRITE, STORE, DROP = b"\x2e\xfd\x10", b"\x2e\xfd\x12\x01", b"\x2e\xfd\x12\x00"
XCP_STORE, STORED_EVENT = b"\xf9\x01\x00\x00", b"\xfd\x03"
LIMIT = 0.075


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    """An ECU that always wants the jets full on."""
    provision(tmp_path / "ecu", image("first"))
    return Rig(tmp_path / "ecu", UNCHECKED, controller_of=lambda bundle: RecordingController(lambda i: 2 * LIMIT))


def values(rig: Rig) -> dict[str, float]:
    return dict(zip(CALIBRATION_NAMES, VALUES.unpack(rig.good(READ)[3:]), strict=True))


def write(rig: Rig, **changes: float) -> None:
    *floats, delay_steps = {**values(rig), **changes}.values()
    rig.good(WRITE + VALUES.pack(*floats, int(delay_steps)))


def unlock(rig: Rig) -> None:
    rig.good(b"\x10\x03")
    rig.unlock(Level.CALIBRATION)


def actions(rig: Rig, since: int = 0) -> list[float]:
    scale = rig.config.operating_point.flow_rate_scale
    return [abs(command.flow_m2_per_s) / scale for command in rig.commands[since:]]


def packets(rig: Rig) -> list[bytes]:
    return [frame.data for frame in rig.sent if frame.frame_id == XCP_RESPONSE_ID]


def ask_xcp(rig: Rig, command: bytes) -> bytes:
    before = len(packets(rig))
    rig.extra = [Frame(frame_id=COMMAND_ID, data=command.ljust(8, b"\x00"))]
    rig.millisecond()
    rig.extra = []
    return (packets(rig)[before:] or [b""])[0]


def good_xcp(rig: Rig, command: bytes) -> bytes:
    answer = ask_xcp(rig, command)
    assert answer[:1] == b"\xff", (command.hex(), answer.hex())
    return answer


def connect(rig: Rig) -> None:
    good_xcp(rig, b"\xff\x00")
    key = KEY.answer(Level.CALIBRATION, good_xcp(rig, b"\xf8\x00\x01")[2:] + good_xcp(rig, b"\xf8\x01\x01")[2:])
    for begin in range(0, len(key), 6):
        good_xcp(rig, bytes([0xF7, len(key) - begin]) + key[begin : begin + 6])


def write_xcp(rig: Rig, name: str, value: float) -> bytes:
    good_xcp(rig, b"\xf6\x00\x00\x00" + (ADDRESS + 4 * CALIBRATION_NAMES.index(name)).to_bytes(4, "little"))
    return ask_xcp(rig, b"\xf0\x04" + struct.pack("<f", value))


def test_the_jets_keep_a_narrower_limit_from_the_next_period_on(rig: Rig) -> None:
    unlock(rig)
    rig.into_control()
    assert actions(rig)[-1] == pytest.approx(LIMIT, rel=1e-3)
    before = len(rig.commands)
    write(rig, action_limit=LIMIT / 2, lift=0.5)
    rig.run(200)
    changed = actions(rig, before - 1)
    assert len(set(changed)) == 2, "no value between"
    assert changed[-1] == pytest.approx(LIMIT / 2, rel=1e-3) and changed[-1] <= LIMIT / 2
    rig.good(DROP)
    rig.run(100)
    connect(rig)
    assert write_xcp(rig, "action_limit", LIMIT / 3) == b"\xff"
    rig.run(200)
    assert actions(rig)[-1] == pytest.approx(LIMIT / 3, rel=1e-2)
    assert values(rig)["action_limit"] == pytest.approx(LIMIT / 3)
    assert {command.mode for command in rig.commands[before:]} == {Mode.CONTROL}


@pytest.mark.slow
def test_it_is_stored_with_the_jets_shut_and_kept_with_its_release(rig: Rig) -> None:
    own = shipped().manifest.mpc.weights.lift
    unlock(rig)
    connect(rig)
    rig.into_control()
    write(rig, lift=0.5)
    # A slow memory must not come into a control period: UDS refuses, XCP waits.
    assert rig.ask(STORE) == b"\x7f\x2e\x22"
    good_xcp(rig, XCP_STORE)
    rig.run(500)
    assert STORED_EVENT not in packets(rig)
    rig.run_asking(False, 1200)
    assert packets(rig).count(STORED_EVENT) == 1
    rig.power_on()
    assert (values(rig)["lift"], rig.good(READ_STORED)[3:]) == (0.5, b"\x01")
    assert ask_xcp(rig, b"\xfd") == b""
    # Another release has its own; the one before finds its calibration again.
    rig.start(image("second"))
    assert values(rig)["lift"] == pytest.approx(own)
    assert rig.good(READ_STORED)[3:] == b"\x00"
    rig.programming()
    rig.good(b"\x31\x01\x02\x07")
    rig.reset()
    assert values(rig)["lift"] == 0.5
    unlock(rig)
    rig.good(DROP)
    rig.power_on()
    assert values(rig)["lift"] == pytest.approx(own)
    # One that the vehicle no longer allows is logged and not used.
    unlock(rig)
    write(rig, command_step=0.07)
    rig.good(STORE)
    rig.config = replace(rig.config, ecu=replace(rig.config.ecu, command_step=0.05))
    rig.power_on()
    assert values(rig)["command_step"] == pytest.approx(0.05)
    assert "calibration_dropped" in rig.log.names()


def test_a_memory_that_fails_is_tried_once(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    tried = []

    def fail(store: Store, blob: bytes | None) -> None:
        tried.append(blob)
        raise MediumError("sector 3 is bad")

    monkeypatch.setattr(Store, "keep_calibration", fail)
    rig.power_on()
    connect(rig)
    assert write_xcp(rig, "lift", 0.5) == b"\xff"
    rig.run(40)
    good_xcp(rig, XCP_STORE)
    rig.run(200)
    assert (len(tried), STORED_EVENT in packets(rig)) == (1, False)


def test_nothing_is_stored_for_a_release_whose_slot_is_being_written(rig: Rig) -> None:
    rig.start(image("second"))
    connect(rig)
    rig.programming()
    rig.announce(image("third"))
    good_xcp(rig, XCP_STORE)
    rig.run(100)
    assert STORED_EVENT not in {packet[:2] for packet in packets(rig)}
    assert good_xcp(rig, b"\xfd")[1] == 0
    assert rig.good(b"\x22\xf1\x86")[3:] == b"\x02"
