"""Traffic out of a DBC, and out of the same network as cantools writes it in another format."""

import os
from pathlib import Path

import cantools
import pytest

from can_bridge.timing.dbc_traffic import read_traffic
from contract.config.vehicle import BusConfig
from contract.errors import BusError
from tests.refused import refused

TAKEN = (0x7E0,)
CLASSIC = BusConfig(frames="classic")
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


def facts(traffic):
    return [(m.name, m.frame_id, m.is_extended, m.is_fd, m.length, m.period_ns) for m in traffic.messages]


def test_every_message_with_a_cycle_time_is_sent(dbc):
    found = read_traffic(dbc(), BusConfig(), TAKEN, seed=0)
    assert facts(found) == [
        ("Long", 0x40, False, True, 20, 10_000_000),
        ("Wheels", 0x100, False, False, 6, 20_000_000),
        ("EngineSpeed", 0x18FEF1FE, True, False, 8, 100_000_000),
    ]
    assert found.left_out == ("OnChange (no cycle time)",)


def test_phases_come_from_the_seed(dbc):
    path = dbc()
    phases = [[m.offset_ns for m in read_traffic(path, BusConfig(), TAKEN, seed=seed).messages] for seed in (0, 0, 1)]
    assert phases[0] == phases[1] != phases[2]
    assert all(0 <= phase < 100_000_000 for phase in phases[0])


def test_another_format_of_the_same_network_gives_the_same_messages(dbc, tmp_path):
    path = dbc()
    other = tmp_path / "vehicle.kcd"
    # KCD knows no CAN FD.
    database = cantools.database.load_file(path)
    assert isinstance(database, cantools.database.can.Database)
    classic = [m for m in database.messages if not m.is_fd]
    other.write_text(cantools.database.can.Database(messages=classic).as_kcd_string(), encoding="utf-8")
    expected = [one for one in facts(read_traffic(path, BusConfig(), TAKEN, seed=0)) if not one[3]]
    assert facts(read_traffic(other, BusConfig(), TAKEN, seed=0)) == expected


def test_data_between_two_lengths_of_can_fd_is_padded(dbc):
    path = dbc(MESSAGES.replace("BO_ 64 Long: 20", "BO_ 64 Long: 33"))
    assert read_traffic(path, BusConfig(), TAKEN, seed=0).messages[0].length == 48


def test_our_own_messages_in_a_vehicles_file_are_left_out(dbc):
    own = 'BO_ 288 Pressure: 16 Engine\n SG_ E2E_CRC : 0|16@1+ (1,0) [0|65535] "" Brake\n'
    attributes = ATTRIBUTES + 'BA_ "GenMsgCycleTime" BO_ 288 20;\n'
    found = read_traffic(dbc(MESSAGES + own, attributes), BusConfig(), TAKEN, seed=0)
    assert "Pressure (stillwake's own)" in found.left_out
    assert "Pressure" not in [m.name for m in found.messages]


def test_an_identifier_in_use_is_refused(dbc):
    for used in [0x120, 0x121, TAKEN[0]]:
        path = dbc(
            MESSAGES.replace("BO_ 256 Wheels", f"BO_ {used} Wheels"), ATTRIBUTES.replace("BO_ 256", f"BO_ {used}")
        )
        with refused(BusError, f"Wheels has identifier {used:#x}, which another node sends"):
            read_traffic(path, BusConfig(), TAKEN, seed=0)


def test_what_our_frames_cannot_be_is_left_out(dbc):
    for changed, reason in [
        (("BO_ 256 Wheels: 6", "BO_ 256 Wheels: 9"), "Wheels (9 bytes: more than a frame)"),
        (('"CANFD_BRS" "1"', '"CANFD_BRS" "0"'), "Long (CAN FD without bit-rate switching)"),
    ]:
        messages, attributes = (text.replace(*changed) for text in (MESSAGES, ATTRIBUTES))
        assert reason in read_traffic(dbc(messages, attributes), BusConfig(), TAKEN, seed=0).left_out, (changed, reason)


def test_can_fd_is_refused_on_a_classic_bus(dbc):
    with pytest.raises(BusError, match=r"Long is CAN FD, which a bus with bus\.frames = classic cannot carry"):
        read_traffic(dbc(), CLASSIC, TAKEN, seed=0)


def test_one_identifier_twice_is_refused(dbc):
    path = dbc(MESSAGES.replace("BO_ 64 Long", "BO_ 256 Long"), ATTRIBUTES.replace("BO_ 64", "BO_ 256"))
    with pytest.raises(BusError, match="have one identifier, 0x100"):
        read_traffic(path, BusConfig(), TAKEN, seed=0)


def test_a_file_with_nothing_to_send_is_refused():
    with pytest.raises(BusError, match=r"no message to send: Pressure \(stillwake's own\)"):
        read_traffic(SHIPPED, BusConfig(), TAKEN, seed=0)


def test_a_damaged_file_is_one_line(tmp_path):
    for name, content, reason in [
        (
            "broken.dbc",
            SHIPPED.read_bytes().replace(b"BO_ 304 ", b"BO_ x "),
            "no description of a CAN bus that cantools can read: ",
        ),
        ("words.dbc", b"no DBC at all", "no description of a CAN bus that cantools can read: "),
        ("bytes.kcd", bytes(range(256)), "no description of a CAN bus that cantools can read: "),
        ("table.csv", b"id,name\n", "expected database format"),
    ]:
        path = tmp_path / name
        path.write_bytes(content)
        with refused(BusError, reason) as raised:
            read_traffic(path, BusConfig(), TAKEN, seed=0)
        assert str(raised.value).startswith(f"{path}: "), (name, content, reason)
        assert "\n" not in str(raised.value), (name, content, reason)


def test_what_is_no_file_is_not_read(tmp_path):
    """A device without an end would fill the memory, and a pipe without a writer would wait for ever."""
    pipe = tmp_path / "traffic.dbc"
    os.mkfifo(pipe)
    for path, what in ((Path("/dev/zero"), "device or pipe"), (pipe, "device or pipe"), (tmp_path, "directory")):
        with pytest.raises(BusError, match=f"{path}: is a {what}, must be a file"):
            read_traffic(path, BusConfig(), (), seed=0)
