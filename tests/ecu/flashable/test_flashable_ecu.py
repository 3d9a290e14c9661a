"""Boot, update, trial, confirmation and revert as they show on the wire."""

import gc
import weakref
from pathlib import Path

import pytest

from can_bridge.bus.interface import BusHealth, BusState
from can_bridge.flashing.verdicts import Verdict
from can_bridge.secoc.key import read_key, write_key
from can_bridge.secoc.securing import Authentication
from can_bridge.uds.services import S3_MS
from can_bridge.wire.message_specs import FRESHNESS_LENGTH, JET_COMMAND_SECURED
from can_bridge.wire.messages import Mode, Reason
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.release.container import files_of
from contract.release.manifest import MANIFEST, open_manifest
from ecu.flashable.flashable_ecu import FlashableEcu
from tests.ecu.flashable.vehicle_ecu import ACTIVATE, CONFIRM_ROUTINE, SELF_TEST, Rig, image, provision


def hash_of(raw: bytes) -> int:
    return int(open_manifest(Path("image"), files_of(raw)[MANIFEST]).digest[:8], 16)


@pytest.mark.slow
def test_without_a_release_it_reports_that_and_one_is_written_tried_and_confirmed(tmp_path: Path) -> None:
    provision(tmp_path / "ecu", None)
    rig = Rig(tmp_path / "ecu")
    rig.programming()
    assert [rig.ask(one)[2] for one in (SELF_TEST, CONFIRM_ROUTINE, b"\x22\xfd\x10")] == [0x22, 0x24, 0x31]
    rig.run_asking(True, 100)
    last = rig.statuses[-1]
    assert (last.state, last.reason, last.bundle_hash) == (Mode.FAULT, Reason.NO_RELEASE, 0)
    assert {(c.enable, c.flow_m2_per_s, c.mode) for c in rig.commands} == {(False, 0.0, Mode.FAULT)}
    # A request does not prevent it: there is nothing to interrupt. It does once a release runs.
    assert rig.write(image("first")) is Verdict.GOOD
    # While it is written, and until the reset, the mode is UPDATE.
    assert (rig.statuses[-1].state, rig.statuses[-1].reason) == (Mode.OFF, Reason.UPDATING)
    rig.good(ACTIVATE)
    assert rig.statuses[-1].bundle_hash == 0
    rig.reset()
    assert rig.statuses[-1].bundle_hash == hash_of(image("first"))
    assert rig.statuses[-1].reason is not Reason.UPDATING
    rig.run_asking(False, 1100)
    rig.programming()
    rig.good(SELF_TEST)
    rig.good(CONFIRM_ROUTINE)
    rig.power_on()
    rig.run(50)
    assert rig.statuses[-1].bundle_hash == hash_of(image("first"))
    order = ["no_release", "session", "unlocked", "update", "checked", "activated", "trial", "confirmed", "booted"]
    names = iter(rig.log.names())
    assert all(name in names for name in order), rig.log.names()


def test_an_earlier_bus_off_is_no_fault_of_the_release_that_boots(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    step = FlashableEcu.step
    health = BusHealth(state=BusState.BUS_OFF, bus_off=1)
    monkeypatch.setattr(FlashableEcu, "step", lambda ecu, now_ns, frames: step(ecu, now_ns, frames, health))
    rig.run_asking(False, 100)
    assert rig.statuses[-1].reason is Reason.BUS_OFF
    health = BusHealth(bus_off=1)
    rig.into_control()
    rig.run_asking(None, 1100)
    rig.good(b"\x14\xff\xff\xff")
    rig.programming()
    rig.reset()
    rig.run_asking(False, 100)
    assert (rig.statuses[-1].state, rig.statuses[-1].reason, rig.statuses[-1].bus_off) == (Mode.OFF, Reason.NONE, 1)
    assert rig.ask(b"\x19\x02\x01") == b"\x59\x02\x7f"


@pytest.mark.parametrize("end", [b"", b"\x10\x01"], ids=["no tester any more", "another session"])
def test_the_end_of_the_session_leads_back_to_the_release_before(rig: Rig, end: bytes) -> None:
    second = image("second")
    rig.programming()
    sent = rig.blocks(second, rig.announce(second))
    received = next(sent)
    rig.run(40)
    assert (rig.statuses[-1].state, rig.statuses[-1].reason) == (Mode.OFF, Reason.UPDATING)
    if end:
        rig.good(end)
        rig.run(100)
    else:
        rig.run(S3_MS - 100)
        assert rig.ecu.resets == 0
        rig.run(200)
    bundle = rig.ecu.cycle.boot.bundle
    assert rig.ecu.resets == 1 and bundle is not None and bundle.name == "first"
    assert rig.statuses[-1].reason is not Reason.UPDATING
    rig.programming()
    assert 0 < rig.announce(second) <= received


@pytest.mark.slow
def test_with_a_key_no_freshness_comes_or_is_taken_twice_over_resets_and_releases(tmp_path: Path) -> None:
    write_key(tmp_path / "bus.key", bytes(range(1, 17)))
    config = Config(bus=BusConfig(key=str(tmp_path / "bus.key")))
    provision(tmp_path / "ecu", None)
    rig = Rig(tmp_path / "ecu", config, authentication=Authentication(key=read_key(tmp_path / "bus.key"), trip=7))
    rig.run(200)
    rig.start(image("first"))
    rig.run_asking(False, 200)
    heard = [one.freshness for one in (rig.ecu.state.verifier, rig.ecu.state.speed.verifier)]
    rig.run_asking(None, 1100)
    rig.programming()
    rig.reset()
    assert [one.freshness for one in (rig.ecu.state.verifier, rig.ecu.state.speed.verifier)] == heard
    assert min(heard) > 0
    spec = JET_COMMAND_SECURED
    secured = [frame.data[spec.protected :] for frame in rig.sent if spec.names(frame)]
    values = [int.from_bytes(one[:FRESHNESS_LENGTH], "big") for one in secured]
    assert (rig.ecu.resets, values[0]) == (2, 7 << 32)
    assert values == list(range(values[0], values[0] + len(values)))


def test_a_reset_leaves_nothing_behind_where_the_collector_is_off(rig: Rig) -> None:
    """Any node on the bus can ask for one, and in real time nothing collects what refers to itself."""
    rig.programming()
    rig.run(100)
    cycle = rig.ecu.cycle
    assert cycle.calibration is not None
    before = [weakref.ref(part) for part in (cycle.store, cycle.link._server, cycle.calibration._xcp)]
    del cycle
    gc.disable()
    try:
        rig.reset()
        rig.run(100)
        assert [part() for part in before] == [None] * 3
    finally:
        gc.enable()
