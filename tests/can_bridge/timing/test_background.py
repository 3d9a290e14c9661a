"""How made-up messages and those of a file fill a bus, and how they are sent."""

import os
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.simulated.medium import Transmission
from can_bridge.timing.background import PERIODS_MS, PeriodicMessage, made_up, read_traffic, send_background
from can_bridge.wire.message_specs import SPECS
from contract.config.vehicle import BusConfig
from contract.errors import BusError, ConfigError
from tests.can_bridge.bus.simulated.disturbing import bus_of
from tests.examples import examples
from tests.refused import refused

OURS = tuple(spec.frame_id for spec in SPECS)
BUSES = st.builds(BusConfig, frames=st.sampled_from(["fd", "classic"]), nominal_bitrate=st.just(500_000))


@examples(20)
@given(load=st.floats(0.02, 0.99), bus=BUSES, seed=st.integers(0, 2**32))
def test_made_up_messages_are_those_of_a_vehicle_and_fill_their_share(load, bus, seed):
    messages = made_up(load, bus, seed=seed)
    assert made_up(load, bus, seed=seed) == messages != made_up(load, bus, seed=seed + 1)
    taken = sum(one.worst_ns(bus) / one.period_ns for one in messages)
    # One frame a second, the rarest, is the most that is left over: 64 bytes of CAN FD, or 8 of classic CAN.
    is_fd = bus.frames == "fd"
    rarest = PeriodicMessage(name="", frame_id=1, is_fd=is_fd, length=64 if is_fd else 8, period_ns=10**9)
    assert load - rarest.worst_ns(bus) / 1e9 - 1e-9 < taken <= load + 1e-9  # 1e-9: sums of floats
    ids = [one.frame_id for one in messages]
    assert ids == sorted(set(ids))
    assert not set(ids) & {*OURS}
    assert all(one.is_fd == is_fd for one in messages)
    assert {one.period_ns for one in messages} <= {ms * 10**6 for ms in PERIODS_MS}
    assert [one.period_ns for one in messages] == sorted(one.period_ns for one in messages)
    assert all(0 <= one.offset_ns < one.period_ns for one in messages)
    if len(messages) > 1:
        assert ids[0] < min(OURS) and ids[-1] > max(OURS)
    with refused(ConfigError, r"load = 1e-05: too small for one message per second"):
        made_up(1e-5, bus, seed=seed)


SHIPPED = Path(__file__).parents[3] / "contract" / "stillwake.dbc"

HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: Engine Brake\n'
MESSAGES = """
BO_ 256 Wheels: 6 Brake
 SG_ Speed : 0|16@1+ (0.01,0) [0|655.35] "km/h" Engine
BO_ 2566844926 EngineSpeed: 8 Engine
 SG_ Rpm : 24|16@1+ (0.125,0) [0|8031.875] "rpm" Brake
BO_ 512 OnChange: 1 Brake
 SG_ Pedal : 0|1@1+ (1,0) [0|1] "" Engine
BO_ 64 Long: 20 Engine
 SG_ Torque : 0|16@1+ (1,0) [0|65535] "Nm" Brake
"""
FORMATS = ["StandardCAN", "ExtendedCAN", *["reserved"] * 12, "StandardCAN_FD", "ExtendedCAN_FD"]
ATTRIBUTES = """
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_ BO_ "VFrameFormat" ENUM FORMATS;
BA_DEF_ BO_ "CANFD_BRS" ENUM "0","1";
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_DEF_DEF_ "CANFD_BRS" "1";
BA_ "GenMsgCycleTime" BO_ 256 20;
BA_ "GenMsgCycleTime" BO_ 2566844926 100;
BA_ "GenMsgCycleTime" BO_ 64 10;
BA_ "VFrameFormat" BO_ 64 14;
""".replace("FORMATS", ",".join(f'"{name}"' for name in FORMATS))


@pytest.fixture
def dbc(tmp_path):
    def write(messages: str = MESSAGES, attributes: str = ATTRIBUTES) -> Path:
        path: Path = tmp_path / "vehicle.dbc"
        path.write_text(HEAD + messages + attributes, encoding="cp1252")
        return path

    return write


def test_every_message_with_a_cycle_time_is_sent(dbc):
    path = dbc()
    found = read_traffic(path, BusConfig(), seed=0)
    facts = [(one.name, one.frame_id, one.is_extended, one.is_fd, one.length, one.period_ns) for one in found.messages]
    assert facts == [
        ("Long", 0x40, False, True, 20, 10_000_000),
        ("Wheels", 0x100, False, False, 6, 20_000_000),
        ("EngineSpeed", 0x18FEF1FE, True, False, 8, 100_000_000),
    ]
    assert found.left_out == ("OnChange (no cycle time)",)
    # The seed draws the phases.
    phases = [[m.offset_ns for m in read_traffic(path, BusConfig(), seed=seed).messages] for seed in (0, 0, 1)]
    assert phases[0] == phases[1] != phases[2]
    assert all(0 <= phase < 100_000_000 for phase in phases[0])


def test_lengths_are_padded_and_what_cannot_be_sent_is_left_out(dbc):
    path = dbc(MESSAGES.replace("BO_ 64 Long: 20", "BO_ 64 Long: 33"))
    assert read_traffic(path, BusConfig(), seed=0).messages[0].length == 48
    own = 'BO_ 288 Pressure: 16 Engine\n SG_ E2E_CRC : 0|16@1+ (1,0) [0|65535] "" Brake\n'
    unswitched = ATTRIBUTES.replace('"CANFD_BRS" "1"', '"CANFD_BRS" "0"')
    for messages, attributes, reason in [
        (MESSAGES + own, ATTRIBUTES + 'BA_ "GenMsgCycleTime" BO_ 288 20;\n', "Pressure (stillwake's own)"),
        (MESSAGES.replace("Wheels: 6", "Wheels: 9"), ATTRIBUTES, "Wheels (9 bytes are more than a frame)"),
        (MESSAGES, unswitched, "Long (CAN FD without bit-rate switching)"),
    ]:
        traffic = read_traffic(dbc(messages, attributes), BusConfig(), seed=0)
        assert reason in traffic.left_out
        assert reason.split()[0] not in [m.name for m in traffic.messages]


def test_what_cannot_go_on_this_bus_is_refused(dbc):
    def renumbered(name: str, old: int, new: int) -> Path:
        messages = MESSAGES.replace(f"BO_ {old} {name}", f"BO_ {new} {name}")
        return dbc(messages, ATTRIBUTES.replace(f"BO_ {old}", f"BO_ {new}"))

    for used in [0x120, 0x121]:
        with refused(BusError, f"Wheels has identifier {used:#x}, which belongs to stillwake"):
            read_traffic(renumbered("Wheels", 256, used), BusConfig(), seed=0)
    with refused(BusError, "have the same identifier, 0x100"):
        read_traffic(renumbered("Long", 64, 256), BusConfig(), seed=0)
    with refused(BusError, r"Long is CAN FD, which a bus with bus\.frames = classic cannot carry"):
        read_traffic(dbc(), BusConfig(frames="classic"), seed=0)
    with refused(BusError, r"no message to send: Pressure \(stillwake's own\)"):
        read_traffic(SHIPPED, BusConfig(), seed=0)


def test_what_describes_no_bus_is_refused_in_one_line(tmp_path, monkeypatch):
    """A device without an end would fill the memory, and a pipe without a writer would wait for ever."""
    unreadable = "not a description of a CAN bus that cantools can read: "
    # cantools would be busy with its bits for half a minute.
    (tmp_path / "long.dbc").write_text("BO_ 416 Drag: 99999999 A\n")
    with refused(BusError, unreadable + "BO_ 416 Drag: 99999999 is the length of a message: must be at most 65536"):
        read_traffic(tmp_path / "long.dbc", BusConfig(), seed=0)
    for name, content, reason in [
        ("broken.dbc", SHIPPED.read_bytes().replace(b"BO_ 304 ", b"BO_ x "), unreadable),
        ("bytes.kcd", bytes(range(256)), unreadable),
        ("table.csv", b"id,name\n", "expected database format"),
        ("missing.dbc", None, "No such file"),
        ("pipe.dbc", None, "is a device or pipe, must be a file"),
        ("/dev/zero", None, "is a device or pipe, must be a file"),
        ("", None, "is a directory, must be a file"),
    ]:
        path = tmp_path / name
        if content is not None:
            path.write_bytes(content)
        elif name == "pipe.dbc":
            os.mkfifo(path)
        with refused(BusError, reason) as raised:
            read_traffic(path, BusConfig(), seed=0)
        assert str(raised.value).startswith(f"{path}: "), name
        assert "\n" not in str(raised.value), name
    monkeypatch.setitem(sys.modules, "cantools.database", None)
    with refused(BusError, r"\.dbc: reading it needs cantools: pip install '\.\[bus\]' in a checkout"):
        read_traffic(SHIPPED, BusConfig(), seed=0)


MS = 10**6
FAST = PeriodicMessage(name="fast", frame_id=0x100, is_fd=True, length=8, period_ns=10 * MS, offset_ns=3 * MS)
SLOW = PeriodicMessage(
    name="slow", frame_id=0x1ABCDE, is_extended=True, is_fd=False, length=2, period_ns=50 * MS, jitter_ns=4 * MS
)


def sent(*messages: PeriodicMessage, seed: int = 1, drift_ppm: float = 0.0) -> list[Transmission]:
    bus, seen, port, _ = bus_of("background", "other", config=BusConfig())
    send_background(bus, port, messages, seed, drift_ppm=drift_ppm)
    bus.advance_to(1000 * MS)
    assert port.refused == 0
    return seen


def test_a_message_comes_at_its_offset_and_every_period_late_by_its_jitter_alone():
    seen = sent(FAST, SLOW)
    assert sent(FAST, SLOW) == seen != sent(FAST, SLOW, seed=2)
    fast, slow = ([item for item in seen if item.frame.is_extended is extended] for extended in (False, True))
    assert {(item.frame.frame_id, item.frame.is_fd, len(item.frame.data)) for item in fast} == {(0x100, True, 8)}
    assert {(item.frame.frame_id, item.frame.is_fd, len(item.frame.data)) for item in slow} == {(0x1ABCDE, False, 2)}
    assert [item.queued_ns for item in fast] == [3 * MS + k * 10 * MS for k in range(100)]
    late = [item.queued_ns - k * 50 * MS for k, item in enumerate(slow)]
    assert (len(late), all(0 <= ns <= 4 * MS for ns in late)) == (20, True)
    assert len(set(late)) > 15
    # Random contents, and those of one message do not depend on another.
    assert len({item.frame.data for item in seen}) > 110
    assert [item.frame.data for item in sent(FAST)] == [item.frame.data for item in fast]


def test_clocks_drift_apart_slowly_and_never_run_fast():
    both = sent(FAST, replace(FAST, frame_id=0x101, offset_ns=8 * MS), drift_ppm=1000.0)
    late = []
    for frame_id, offset_ns in ((0x100, 3 * MS), (0x101, 8 * MS)):
        queued = [item.queued_ns - offset_ns for item in both if item.frame.frame_id == frame_id]
        steps = {after - before for before, after in pairwise(queued)}
        assert len(steps) == 1
        assert 0 < steps.pop() - FAST.period_ns < 0.001 * FAST.period_ns
        late.append(queued[-1] - 99 * FAST.period_ns)
    assert late[0] != late[1]
