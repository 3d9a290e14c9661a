"""Faults of an ECU in its control periods, as a tester reads and clears them, and as they outlive a loss of power."""

import struct

import pytest

from can_bridge.flashing.backing import MediumError
from can_bridge.flashing.folder_backing import FolderBacking
from can_bridge.uds.fault_codes import CODES
from can_bridge.wire.messages import Mode, Reason
from tests.ecu.flashable.vehicle_ecu import Rig, provision

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
    moment = rig.ask(b"\x19\x04" + LOST + b"\x01")
    time_ms, mode, missed, overruns, *cp = struct.unpack(">8x2xI2xB2xH2xH2x4f", moment)
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
    drives = {Mode.CONTROL, Mode.HOLD, Mode.DECAY}
    assert {status.state for status in rig.statuses[heard[0] :]} <= drives
    assert rig.ask(b"\x28\x01\x01") in (b"\x7f\x28\x22", b"\x7f\x28\x7f")
    rig.request = False
    rig.run(6000)


def test_without_a_release_that_is_the_fault_and_a_worn_memory_is_reported_once(tmp_path, monkeypatch):
    provision(tmp_path / "ecu", None)

    def worn(self, kind, record):
        raise MediumError("worn", 0)

    monkeypatch.setattr(FolderBacking, "keep", worn)
    rig = Rig(tmp_path / "ecu")
    rig.run(200)
    assert rig.ask(CONFIRMED) == b"\x59\x02\x7f" + CODES[Reason.NO_RELEASE].to_bytes(3, "big") + b"\x2f"
    assert rig.log.names() == ["no_release", "faults_not_kept"]
