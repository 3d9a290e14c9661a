"""Diagnosis next to control: it changes no bit of what is commanded, is refused where it would, and reads faults."""

import struct
from pathlib import Path
from random import Random

import pytest

from can_bridge.flashing.backing import MediumError
from can_bridge.flashing.folder_backing import FolderBacking
from can_bridge.uds.fault_memory import CODES
from can_bridge.wire.frame import FD_LENGTHS, Frame
from can_bridge.wire.messages import Mode, Reason
from contract.release.checks import Bundle
from contract.runtime.onnx_session import OnnxController
from ecu.ecu import Ecu
from ecu.flashable.links import MOST_FRAMES
from tests.can_bridge.uds.addresses import REQUEST_ID
from tests.ecu.conftest import RecordingController
from tests.ecu.flashable.vehicle_ecu import MS, UNCHECKED, Rig, image, provision

EXTENDED, PROGRAMMING, PRECONDITIONS = b"\x10\x03", b"\x10\x02", b"\x31\x01\x02\x03"
NOT_NOW = 0x22


@pytest.mark.slow
def test_neither_a_tester_that_asks_nor_a_flood_changes_a_bit_of_the_commands(tmp_path: Path) -> None:
    provision(tmp_path / "ecu", image("first"))
    rig = Rig(tmp_path / "ecu", UNCHECKED, controller_of=OnnxController.of)
    rig.into_control()
    for _ in range(2):
        rig.good(EXTENDED)
        for did in (0xF18C, 0xF191, 0xF195, 0xFD00, 0xFD01, 0xFD02, 0xFD03, 0xFD04, 0xFD10, 0xFD11, 0xFD12):
            rig.good(b"\x22" + did.to_bytes(2, "big"))
        assert rig.ask(PROGRAMMING)[2] == NOT_NOW
        # Wrong keys, until none is taken for a while.
        for count in (1, 2):
            rig.ask(b"\x27\x03")
            assert rig.ask(b"\x27\x04" + bytes(16))[2] in (0x35, 0x36, 0x24)
            assert "key_refused" in rig.log.names(), count
    random = Random(0)
    for _ in range(30):
        frames = [
            Frame(frame_id=random.choice((REQUEST_ID, 0x7D0)), data=random.randbytes(random.choice(FD_LENGTHS)))
            for _ in range(2 * MOST_FRAMES)
        ]
        rig.extra, before = frames, len(rig.sent)
        rig.millisecond()
        # Its work in a millisecond is bounded.
        assert len(rig.sent) - before <= 2 + 8 + 2 * MOST_FRAMES
    rig.extra = ()
    assert rig.statuses[-1].state is Mode.CONTROL
    assert len({command.flow_m2_per_s for command in rig.commands}) > 10
    # What the ECU without a store answers to the same pressures at the same times.
    bundle = rig.ecu.cycle.boot.bundle
    assert isinstance(bundle, Bundle)
    plain = Ecu(bundle, OnnxController.of(bundle), UNCHECKED)
    assert [sent for _, _, sent in rig.controls] == [plain.step(now_ns, frames) for now_ns, frames, _ in rig.controls]
    # It still answers, too.
    rig.run(3000)
    rig.answers.clear()
    rig.tester.take()
    assert rig.good(b"\x22\xf1\x8c")[3:] == b"42"


@pytest.mark.slow
def test_a_flood_of_requests_does_not_stop_long_work(rig: Rig) -> None:
    raw = image("second")
    rig.programming()
    for _ in rig.blocks(raw, rig.announce(raw)):
        pass
    rig.tester.send(b"\x31\x01\xff\x01")
    rig.millisecond()
    rig.extra = [Frame(frame_id=REQUEST_ID, data=b"\x02\x3e\x00" + bytes(5))]
    before = len(rig.answers)
    rig.run(2000)
    assert any(answer[:4] == b"\x71\x01\xff\x01" for answer in rig.answers[before:])


def test_a_reset_waits_for_a_period_that_shuts_the_jets(rig: Rig) -> None:
    rig.run_asking(False, 1500)
    rig.good(PROGRAMMING)
    rig.run((rig.due_ns - rig.now_ns) // MS - 1)
    # The request for control rises behind the request for a reset.
    rig.tester.send(b"\x11\x01")
    rig.request = True
    rig.run(3)
    assert (rig.ecu.resets, rig.commands[-1].enable) == (0, True)
    rig.run(2 * rig.config.period_ns // MS)
    assert rig.ecu.resets == 1 and not rig.commands[-1].enable
    # The request that is set does not count for the new power cycle.
    rig.commands.clear()
    rig.run(500)
    assert not any(command.enable for command in rig.commands)


def test_no_programming_while_the_jets_may_run(rig: Rig) -> None:
    rig.good(PROGRAMMING)
    rig.into_control()
    # A session from before, to begin which takes no key, resets no control that runs.
    assert rig.ask(b"\x11\x01")[2] == NOT_NOW
    rig.run(100)
    assert (rig.ecu.resets, rig.statuses[-1].state) == (0, Mode.CONTROL)
    rig.good(EXTENDED)
    assert rig.ask(PRECONDITIONS)[2] == NOT_NOW
    assert rig.ask(PROGRAMMING)[2] == NOT_NOW
    # The pressures end: the jets shut, but whether the request is still set is unknown for a second.
    rig.run_asking(None, 500)
    assert not rig.commands[-1].enable
    assert rig.ask(PROGRAMMING)[2] == NOT_NOW
    rig.run(600)
    rig.good(EXTENDED)
    rig.good(PRECONDITIONS)
    rig.good(PROGRAMMING)


def test_no_programming_while_the_vehicle_asks_for_control_and_does_not_get_it(rig: Rig) -> None:
    # From power-on: the request is set and has not risen, so the jets stay shut.
    rig.run_asking(True, 1000)
    assert rig.statuses[-1].reason is Reason.NOT_ARMED
    assert rig.ask(PROGRAMMING)[2] == NOT_NOW
    rig.run_asking(False, 1100)
    rig.programming()
    # One between session and announcement counts as well.
    rig.run_asking(True, 2000)
    assert rig.statuses[-1].state is Mode.CONTROL
    assert rig.ask(b"\x31\x01\xff\x00" + bytes(36))[2] == NOT_NOW
    rig.run(40)
    assert rig.statuses[-1].state is Mode.CONTROL


def test_only_a_reset_leads_out_of_update(rig: Rig) -> None:
    rig.run_asking(False, 100)
    rig.programming()
    rig.announce(image("second"))
    rig.run_asking(True, 1000)
    assert (rig.statuses[-1].state, rig.statuses[-1].reason) == (Mode.OFF, Reason.UPDATING)
    assert not any(command.enable for command in rig.commands)
    # It is allowed though control is asked for.
    rig.reset()
    rig.into_control()


LOST = CODES[Reason.STREAM_LOST].to_bytes(3, "big")
CONFIRMED = b"\x19\x02\x08"


def test_a_fault_is_entered_with_its_moment_kept_over_power_and_cleared_while_the_jets_are_shut(rig):
    assert rig.ask(CONFIRMED) == b"\x59\x02\x7f"
    rig.into_control()
    assert rig.ask(CONFIRMED) == b"\x59\x02\x7f"
    assert rig.ask(b"\x19\x02\x40") == b"\x59\x02\x7f", "all tests have passed"
    assert rig.ask(b"\x14\xff\xff\xff") == b"\x7f\x14\x22"
    rig.request, began_ns, missed_before = None, rig.now_ns, rig.statuses[-1].missed
    rig.run(1000)
    assert rig.statuses[-1].reason is Reason.STREAM_LOST
    rig.power_on()
    assert rig.ask(CONFIRMED) == b"\x59\x02\x7f" + LOST + b"\x6c"
    time_ms, mode, missed, overruns, *cp = struct.unpack(">8x2xI2xB2xH2xH2x4f", rig.ask(b"\x19\x04" + LOST + b"\x01"))
    assert (mode, overruns) == (Mode.DECAY, 0)
    assert missed - missed_before == rig.config.ecu.hold_periods + rig.config.ecu.decay_periods + 1
    assert 0 <= time_ms * 1_000_000 - began_ns < 1_000_000_000
    assert cp == pytest.approx([0.1 * (1 + i) for i in range(4)], abs=0.1)
    assert rig.ask(b"\x14" + LOST) == b"\x54"
    rig.power_on()
    assert rig.ask(CONFIRMED) == b"\x59\x02\x7f"


def test_silence_is_for_a_bench_and_never_for_jets_that_can_run(rig):
    rig.run(100)
    rig.good(b"\x10\x03")
    rig.good(b"\x28\x01\x01")
    heard = len(rig.statuses), len(rig.commands)
    rig.run(500)
    assert (len(rig.statuses), len(rig.commands)) == heard
    rig.into_control()
    assert rig.statuses[-1].state is Mode.CONTROL
    assert {status.state for status in rig.statuses[heard[0] :]} <= {Mode.CONTROL, Mode.HOLD, Mode.DECAY}
    assert rig.ask(b"\x28\x01\x01") in (b"\x7f\x28\x22", b"\x7f\x28\x7f")
    # The last command shuts the jets; without it the vehicle would follow the one before.
    driven = len(rig.commands)
    rig.run_asking(False, 200)
    assert [(c.mode, c.enable, c.flow_m2_per_s) for c in rig.commands[driven:]] == [(Mode.OFF, False, 0.0)]


def test_a_controller_that_fails_again_is_entered_again(rig, monkeypatch):
    """Its fault ends and begins in one period, in which the request rises."""
    rig.into_control()
    monkeypatch.delattr(RecordingController, "control_step")
    internal = CODES[Reason.INTERNAL].to_bytes(3, "big")
    for _ in range(2):
        rig.run_asking(False, 200)
        rig.good(b"\x14\xff\xff\xff")
        assert rig.ask(CONFIRMED) == b"\x59\x02\x7f"
        rig.run_asking(True, 40)
        assert rig.statuses[-1].reason is Reason.INTERNAL
        assert rig.ask(CONFIRMED)[3:6] == internal


def test_without_a_release_that_is_the_fault_and_a_worn_memory_is_reported_once(tmp_path, monkeypatch):
    provision(tmp_path / "ecu", None)

    def worn(self, kind, record):
        raise MediumError("worn")

    monkeypatch.setattr(FolderBacking, "keep", worn)
    rig = Rig(tmp_path / "ecu")
    rig.run(200)
    assert rig.ask(CONFIRMED) == b"\x59\x02\x7f" + CODES[Reason.NO_RELEASE].to_bytes(3, "big") + b"\x2f"
    assert rig.log.names() == ["no_release", "faults_not_kept"]
