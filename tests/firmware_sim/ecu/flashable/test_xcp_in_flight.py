"""The goal of an ECU that controls, changed by a measurement tool: frames of XCP beside those of diagnosis."""

import struct
from pathlib import Path

import pytest

from can_bridge.calibration.segment import ADDRESS
from can_bridge.calibration.xcp import COMMAND_ID, RESPONSE_ID
from can_bridge.flashing.access_level import Level
from can_bridge.flashing.medium import WornOutError
from can_bridge.flashing.store import Store
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Mode
from contract.controller.calibration import NAMES
from tests.firmware_sim.conftest import RecordingController
from tests.firmware_sim.ecu.flashable.vehicle_ecu import ACCESS, Rig, image, provision

LIMIT = 0.075
READ = b"\x22\xfd\x10"
STORE, STORED_EVENT = b"\xf9\x01\x00\x00", b"\xfd\x03"
OFFSETS = {name: 4 * index for index, name in enumerate(NAMES)}


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    """Of an ECU that always wants the jets full on."""
    provision(tmp_path / "ecu", image("first"))
    return Rig(tmp_path / "ecu", controller_of=lambda bundle: RecordingController(lambda i: 2 * LIMIT))


def packets(rig: Rig) -> list[bytes]:
    """To the tool, so far."""
    return [frame.data for frame in rig.sent if frame.frame_id == RESPONSE_ID]


def ask(rig: Rig, command: bytes) -> bytes:
    """The answer within the millisecond."""
    before = len(packets(rig))
    rig.extra = [Frame(frame_id=COMMAND_ID, data=command.ljust(8, b"\x00"))]
    rig.millisecond()
    rig.extra = []
    answers = packets(rig)[before:]
    return answers[0] if answers else b""


def good(rig: Rig, command: bytes) -> bytes:
    answer = ask(rig, command)
    assert answer[:1] == b"\xff", (command.hex(), answer.hex())
    return answer


def connect(rig: Rig) -> None:
    good(rig, b"\xff\x00")
    seed = good(rig, b"\xf8\x00\x01")[2:] + good(rig, b"\xf8\x01\x01")[2:]
    key = ACCESS.answer(Level.CALIBRATION, seed)
    for begin in range(0, len(key), 6):
        good(rig, bytes([0xF7, len(key) - begin]) + key[begin : begin + 6])


def write(rig: Rig, name: str, value: float) -> bytes:
    good(rig, b"\xf6\x00\x00\x00" + (ADDRESS + OFFSETS[name]).to_bytes(4, "little"))
    return ask(rig, b"\xf0\x04" + struct.pack("<f", value))


def value(rig: Rig, name: str) -> float:
    """As diagnosis reads it."""
    (found,) = struct.unpack_from("<f", rig.good(READ), 3 + OFFSETS[name])
    return float(found)


def into_control(rig: Rig) -> None:
    rig.request = False
    rig.run(100)
    rig.request = True
    for _ in range(5000):
        if rig.commands[-1].mode is Mode.CONTROL:
            break
        rig.millisecond()
    rig.run(60)


def actions(rig: Rig, since: int = 0) -> list[float]:
    scale = rig.config.operating_point.flow_rate_scale
    return [abs(command.flow_m2_per_s) / scale for command in rig.commands[since:]]


def test_a_tool_narrows_the_limit_of_the_jets_while_they_are_on(rig: Rig) -> None:
    connect(rig)
    into_control(rig)
    assert actions(rig)[-1] == pytest.approx(LIMIT, rel=1e-3)
    assert write(rig, "action_limit", LIMIT / 2) == b"\xff"
    before = len(rig.commands)
    rig.run(200)
    assert all(0.0 < action <= LIMIT / 2 for action in actions(rig, before))
    assert actions(rig)[-1] == pytest.approx(LIMIT / 2, rel=1e-3)
    assert value(rig, "action_limit") == pytest.approx(LIMIT / 2)
    good(rig, b"\xeb\x01\x00\x01")
    rig.run(100)
    assert actions(rig)[-1] == pytest.approx(LIMIT, rel=1e-3)
    assert {command.mode for command in rig.commands[before:]} == {Mode.CONTROL}


def test_nothing_wider_and_nothing_without_the_key(rig: Rig) -> None:
    good(rig, b"\xff\x00")
    assert write(rig, "action_limit", LIMIT / 2) == b"\xfe\x25"
    connect(rig)
    assert write(rig, "action_limit", 0.0751) == b"\xfe\x22"
    assert value(rig, "action_limit") == pytest.approx(LIMIT)


def test_half_of_a_value_is_not_used(rig: Rig) -> None:
    connect(rig)
    into_control(rig)
    good(rig, b"\xf6\x00\x00\x00" + (ADDRESS + OFFSETS["action_limit"]).to_bytes(4, "little"))
    good(rig, b"\xf0\x02" + struct.pack("<f", LIMIT / 3)[:2])
    before = len(rig.commands)
    rig.run(100)
    assert actions(rig, before) == pytest.approx([LIMIT] * len(actions(rig, before)), rel=1e-3)
    good(rig, b"\xf0\x02" + struct.pack("<f", LIMIT / 3)[2:])
    rig.run(200)
    assert actions(rig)[-1] == pytest.approx(LIMIT / 3, rel=1e-2)


def test_storing_waits_until_the_jets_are_shut_and_outlives_power(rig: Rig) -> None:
    connect(rig)
    into_control(rig)
    write(rig, "lift", 0.5)
    good(rig, STORE)
    rig.run(500)
    assert STORED_EVENT not in packets(rig)
    rig.request = False
    rig.run(1200)
    assert packets(rig).count(STORED_EVENT) == 1
    rig.power_on()
    assert value(rig, "lift") == 0.5
    assert ask(rig, b"\xfd") == b""


def test_diagnosis_and_a_tool_write_the_same_values(rig: Rig) -> None:
    connect(rig)
    rig.good(b"\x10\x03")
    rig.unlock(Level.CALIBRATION)
    raw = bytearray(rig.good(READ)[3:])
    struct.pack_into("<f", raw, OFFSETS["effort"], 0.125)
    rig.good(b"\x2e\xfd\x10" + bytes(raw))
    effort = (ADDRESS + OFFSETS["effort"]).to_bytes(4, "little")
    assert good(rig, b"\xf4\x04\x00\x00" + effort) == b"\xff" + struct.pack("<f", 0.125)
    assert write(rig, "effort", 0.25) == b"\xff"
    assert value(rig, "effort") == 0.25


def test_a_memory_that_fails_is_tried_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tried = []

    def fail(store: Store, blob: bytes | None) -> None:
        tried.append(blob)
        raise WornOutError("sector 3 is bad", 0)

    monkeypatch.setattr(Store, "keep_calibration", fail)
    provision(tmp_path / "ecu", image("first"))
    rig = Rig(tmp_path / "ecu")
    connect(rig)
    assert write(rig, "lift", 0.5) == b"\xff"
    rig.run(40)
    before = len(packets(rig))
    good(rig, STORE)
    rig.run(200)
    assert len(tried) == 1
    assert STORED_EVENT not in {packet[:2] for packet in packets(rig)[before:]}


def test_nothing_is_stored_for_a_release_whose_slot_is_written_anew(rig: Rig) -> None:
    rig.start(image("second"))
    connect(rig)
    rig.programming()
    rig.announce(image("third"))
    good(rig, STORE)
    rig.run(100)
    assert STORED_EVENT not in {packet[:2] for packet in packets(rig)}
    assert good(rig, b"\xfd")[1] == 0
    assert rig.good(b"\x22\xf1\x86")[3:] == b"\x02"
