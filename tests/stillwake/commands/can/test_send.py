"""`stillwake can send` and `keygen --secret`: frames on a virtual bus, and a key that is written once; and what no bus
command can do, which is one line that names the value."""

import stat

from can_bridge.e2e.profiles import PROFILE_5
from tests.can_bridge.uds.test_security import cmac
from tests.stillwake.commands.can.virtual_bus import VIRTUAL, taken, write

DECODE = {
    "empty.log": "empty.log: contains no CAN frame",
    "cut.blf": "cut.blf: ",
    "good.log --csv good.log": "is the file to read",
    "good.log --json good.log": "--json good.log: this command reads or writes another file there",
    "good.log --json both --csv both": "--json both: this command reads or writes another file there",
    "good.log --csv folder": "it is a directory",
    "good.log --set bus.interface=virtual": "`can decode` does not use it",
}
LOAD = {
    "--set bus.background.dbc=none.dbc": "none.dbc: No such file or directory",
    "--set bus.interface=virtual": "--set bus.interface: `can load` does not use it",
    "--json cut.blf": "--json cut.blf: exists, but contains no figures of a command; name another file",
}
MONITOR = {
    "empty.log": "empty.log: contains no CAN frame",
    "": "that bus exists only within a run",
    "empty.log --for 2": "--for is only for a bus",
    "--for inf": "--for inf: must be a number above 0",
    "--set bus.interface=nonsense": "nonsense",
}
SEND = {
    "Pressures": "other frames, from a log",
    "PressureSecured": "give the key with --set bus.key=FILE",
    "PressureSecured --set bus.key=key.bin": "give --trip, a number of power cycles",
    "PressureSecured --trip 2 --set bus.key=no.bin": "no.bin: cannot read the key",
    "Pressure --trip 2": "Pressure has no freshness value",
    "Pressure --set bus.key=key.bin": "is sent without authentication",
    "PressureClassic --counter 16": "--counter 16: must be in 0..15 for PressureClassic",
    "Pressure --set bus.frames=classic": "Pressure is a CAN FD message; use a message ending in Classic",
    "Pressure --period nan": "--period nan: must be a number above 0",
    "Pressure --set bus.interface=simulated": "that bus exists only within a run",
    "Pressure --set ecu.delay_steps=1": "`can send` does not use it",
}


def test_send_puts_protected_frames_on_the_bus(printed, peer):
    out = printed("can", "send", "JetCommand", "Flow=1.5", "Mode=CONTROL", "--count", 3, "--counter", 254, *VIRTUAL)
    assert out.splitlines()[-1] == "sent 3 frames"  # after lines on a slow start
    frames = taken(peer)
    assert [(one.arbitration_id, one.is_fd, one.bitrate_switch) for one in frames] == [(0x130, True, True)] * 3
    assert [one.data[2] for one in frames] == [254, 255, 0]
    assert all(PROFILE_5.check(bytes(one.data), data_id=0x5702) for one in frames)
    # An adapter of classic CAN cannot be opened for CAN FD.
    for words in (("send", "PressureClassic"), ("monitor", "--for", 0.1)):
        printed("can", *words, "--set", "bus.frames=classic", *VIRTUAL)


def test_send_signs_messages_of_the_secured_set_with_a_key_that_is_written_once(printed, refused, peer, tmp_path):
    """Against the layout in the DBC's comments: CMAC over data ID, bytes in front of the freshness, and freshness."""
    key = tmp_path / "bus.key"
    made = printed("keygen", "--secret", key)
    assert f"--set bus.key={key}" in made and f"--access {key}" in made
    content = key.read_text()
    assert stat.S_IMODE(key.stat().st_mode) == 0o600 and content.strip() not in made
    assert refused("keygen", "--secret", key) == f"error: {key}: exists already; a key is never overwritten\n"
    assert key.read_text() == content
    words = ("PressureSecured", "Pressure0=-12.5", "Valid0=1", "--count", 2, "--trip", 7, "--set", f"bus.key={key}")
    assert printed("can", "send", *words, *VIRTUAL).splitlines()[-1] == "sent 2 frames"  # after lines on a slow start
    frames = [bytes(one.data) for one in taken(peer)]
    assert [int.from_bytes(data[16:24], "big") for data in frames] == [7 << 32, 7 << 32 | 1]
    secret = bytes.fromhex(content.strip())
    assert [cmac(secret, (0x5704).to_bytes(2, "big") + data[:24])[:8] for data in frames] == [x[24:] for x in frames]
    assert [PROFILE_5.check(data[:16], data_id=0x5704) for data in frames] == [True, True]


def test_what_no_bus_command_can_do_is_one_line_and_sends_nothing(all_refused, peer, tmp_path):
    write(tmp_path / "good.log", 1)
    write(tmp_path / "cut.blf", 100)
    (tmp_path / "cut.blf").write_bytes((tmp_path / "cut.blf").read_bytes()[:-100])
    (tmp_path / "empty.log").touch()
    (tmp_path / "folder").mkdir()
    all_refused("can decode --summary", DECODE)
    all_refused("can load", LOAD)
    all_refused("can monitor", MONITOR)
    all_refused(("can", "send", *VIRTUAL), SEND)
    assert taken(peer) == []
