"""`stillwake can monitor|record|replay|send|decode` in this process: a virtual bus, logs, and what is refused."""

import csv
import json
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import pytest
from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.cmac import CMAC

import contract
from can_bridge.e2e import profile5
from can_bridge.logs.frame_log import recording_messages
from can_bridge.logs.log_reader import read_messages
from stillwake.stopping import until_stopped
from tests.stillwake.commands.bus_traffic import PER_PERIOD, write

DBC = Path(contract.__file__).parent / "stillwake.dbc"
VIRTUAL = ("--set", "bus.interface=virtual", "--set", "bus.channel=test-can")


@pytest.fixture
def peer() -> Iterator[can.BusABC]:
    """Another node on the same bus."""
    with can.Bus(interface="virtual", channel="test-can", protocol=can.CanProtocol.CAN_FD) as bus:
        yield bus


def taken(peer: can.BusABC) -> list[can.Message]:
    found = []
    while (message := peer.recv(timeout=0.0)) is not None:
        found.append(message)
    return found


def flat(text: str) -> str:
    return " ".join(text.split())


def test_send_puts_protected_frames_on_the_bus(cli: Callable[..., Any], peer: can.BusABC) -> None:
    got = cli("can", "send", "JetCommand", "Flow=1.5", "Mode=CONTROL", "--count", 3, "--counter", 254, *VIRTUAL)
    assert (got.code, got.out) == (0, "sent 3 frames\n")
    frames = taken(peer)
    assert [(one.arbitration_id, one.is_fd, one.bitrate_switch) for one in frames] == [(0x130, True, True)] * 3
    assert [one.data[2] for one in frames] == [254, 255, 0]
    assert all(profile5.check(bytes(one.data), data_id=0x5702) for one in frames)


def cmac(key: bytes, message: bytes) -> bytes:
    computing = CMAC(AES(key))
    computing.update(message)
    return computing.finalize()


def test_send_signs_messages_of_the_secured_set(cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path) -> None:
    """Against the layout in the DBC's comments: CMAC over data ID, bytes in front of the freshness, and freshness."""
    key = tmp_path / "bus.key"
    assert cli("can", "keygen", key).code == 0
    words = ("PressureSecured", "Pressure0=-12.5", "Valid0=1", "--count", 2, "--trip", 7, "--set", f"bus.key={key}")
    got = cli("can", "send", *words, *VIRTUAL)
    assert (got.code, got.out) == (0, "sent 2 frames\n")
    frames = [bytes(one.data) for one in taken(peer)]
    assert [int.from_bytes(data[16:24], "big") for data in frames] == [7 << 32, 7 << 32 | 1]
    secret = bytes.fromhex(key.read_text().strip())
    assert [cmac(secret, (0x5704).to_bytes(2, "big") + data[:24])[:8] for data in frames] == [x[24:] for x in frames]
    assert [profile5.check(data[:16], data_id=0x5704) for data in frames] == [True, True]


@pytest.fixture
def signed_log(cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path) -> Path:
    """Three genuine frames, and the first again; beside it `bus.key` and another one, `other.key`."""
    for name in ("bus.key", "other.key"):
        assert cli("can", "keygen", tmp_path / name).code == 0
    setting = ("--set", f"bus.key={tmp_path / 'bus.key'}")
    assert cli("can", "send", "PressureSecured", "--count", 3, "--trip", 1, *setting, *VIRTUAL).code == 0
    frames = taken(peer)
    with recording_messages(tmp_path / "signed.log") as append:
        for i, one in enumerate([*frames, frames[0]]):
            one.timestamp = 100.0 + 0.02 * i
            append(one)
    return tmp_path / "signed.log"


@pytest.mark.parametrize(
    ("key", "counts", "is_checked"),
    [
        ("bus.key", {"OK": 3, "not fresh": 1}, True),
        ("other.key", {"not authentic": 4}, True),
        (None, {"OK": 3, "wrong sequence": 1}, False),
    ],
)
def test_decode_and_monitor_check_the_mac_with_a_key_and_say_so_without_one(
    cli: Callable[..., Any], signed_log: Path, key: str | None, counts: dict[str, int], is_checked: bool
) -> None:
    setting = () if key is None else ("--set", f"bus.key={signed_log.parent / key}")
    made = signed_log.with_suffix(".json")
    got = cli("can", "decode", signed_log, "--json", made, "--csv", signed_log.with_suffix(".csv"), *setting)
    assert got.code == 0, got.err
    (message,) = json.loads(made.read_text())["figures"]["messages"]
    assert (message["checks"], message["mac_checked"]) == (counts, is_checked)
    assert ("MAC not checked: name the key" in got.out) is not is_checked
    ends = [line.rpartition("[")[2] for line in got.out.splitlines() if "PressureSecured:" in line]
    with signed_log.with_suffix(".csv").open(newline="") as file:
        macs = [row["mac"] for row in csv.DictReader(file) if row["signal"] == "Pressure0"]
    if key == "bus.key":
        assert ends == ["E2E OK, MAC OK]"] * 3 + ["MAC not fresh]"]
        assert macs == ["OK"] * 3 + ["not fresh"]
    elif key is None:
        assert ends == ["E2E OK, MAC not checked]"] * 3 + ["E2E wrong sequence, MAC not checked]"]
        assert macs == ["not checked"] * 4
    else:
        assert ends == ["MAC not authentic]"] * 4
        assert macs == ["not authentic"] * 4
    seen = cli("can", "monitor", "--log", signed_log, "--once", *setting)
    assert seen.code == 0, seen.err
    assert f" lost, {4 - counts.get('OK', 0)} refused" in seen.out
    assert (", MAC not checked" in seen.out) is not is_checked
    newest = {"bus.key": "not fresh", "other.key": "not authentic", None: "wrong sequence"}[key]
    assert newest in flat(seen.out)


def test_send_raw_frames_of_every_kind(cli: Callable[..., Any], peer: can.BusABC) -> None:
    words = ("123#1122", "1ABCDEF0##1AABBCC", "7FF#R4")
    got = cli("can", "send", *(word for one in words for word in ("--raw", one)), "--count", 2, *VIRTUAL)
    assert (got.code, got.out) == (0, "sent 6 frames\n")
    frames = taken(peer)
    assert [(one.arbitration_id, one.is_extended_id, one.is_remote_frame, one.is_fd) for one in frames[:3]] == [
        (0x123, False, False, False),
        (0x1ABCDEF0, True, False, True),
        (0x7FF, False, True, False),
    ]
    assert len(frames) == 6


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["Pressure", "Pressure0=1e9"], "must be in -3276.8..3276.7"),
        (["Pressures"], "is none of Pressure, "),
        ([], "name a message and its values, or give --raw"),
        (["Pressure", "--raw", "123#"], "one of the two"),
        (["--raw", "12#"], "must be ID#DATA"),
        (["PressureSecured"], "name its key with --set bus.key=FILE"),
        (["PressureSecured", "--set", "bus.key=key.bin"], "name its power cycle with --trip"),
        (["PressureSecured", "--trip", "2", "--set", "bus.key=no.bin"], "no.bin: cannot read the key"),
        (["Pressure", "--trip", "2"], "Pressure has no freshness value"),
        (["--raw", "123#", "--trip", "2"], "--trip: goes with a message of the secured set"),
        (["Pressure", "--set", "bus.key=key.bin"], "is sent without authentication"),
        (["PressureClassic", "--counter", "16"], "--counter 16: must be in 0..15 for PressureClassic"),
        (["Pressure", "--period", "nan"], "--period nan: must be a number above 0"),
        (["Pressure", "--set", "bus.interface=simulated"], "that bus exists within a run only"),
        (["Pressure", "--set", "bus.interface=nonsense"], "nonsense"),
        (["Pressure", "--set", "ecu.delay_steps=1"], "`can send` does not use it"),
    ],
)
def test_send_refuses_in_one_line(cli: Callable[..., Any], peer: can.BusABC, words: list[str], error: str) -> None:
    got = cli("can", "send", *VIRTUAL, *words)
    assert got.code == 1
    assert error in got.err
    assert got.err.count("\n") == 1
    assert taken(peer) == []


@pytest.mark.parametrize("suffix", [".log", ".asc", ".blf", ".trc"])
def test_record_writes_every_kind_of_frame(
    cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"a{suffix}"
    sent = [
        can.Message(timestamp=1.0, arbitration_id=0x123, is_extended_id=False, data=b"\1\2"),
        can.Message(timestamp=1.1, arbitration_id=0x1ABCDEF0, is_fd=True, bitrate_switch=True, data=bytes(64)),
        can.Message(timestamp=1.2, arbitration_id=0x7FF, is_extended_id=False, is_remote_frame=True),
        can.Message(timestamp=1.3, is_error_frame=True),
        can.Message(timestamp=1.4, arbitration_id=0x120, is_extended_id=False, is_fd=True, data=bytes(16)),
    ]
    thread = threading.Thread(target=_send_when_heard, args=(peer, sent))
    thread.start()
    got = cli("can", "record", path, "--frames", len(sent), *VIRTUAL)
    thread.join()
    assert got.code == 0, got.err
    assert f"wrote {path}: 5 frames, {path.stat().st_size} bytes" in got.out
    assert ("note: .trc does not keep error frames: 1" in got.out) is (suffix == ".trc")
    kept = [one for one in sent if suffix != ".trc" or not one.is_error_frame]
    read = list(read_messages(path))
    assert [(one.is_error_frame, one.is_remote_frame, bytes(one.data)) for one in read] == [
        (one.is_error_frame, one.is_remote_frame, bytes(one.data)) for one in kept
    ]
    assert [item.name for item in tmp_path.iterdir()] == [path.name]


def _send_when_heard(peer: can.BusABC, messages: list[can.Message]) -> None:
    """A virtual bus keeps nothing for those who come later."""
    deadline = time.monotonic() + 30.0
    while len(_nodes()) < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    for message in messages:
        peer.send(message)


def _nodes() -> list[Any]:
    from can.interfaces.virtual import channels

    return list(channels.get("test-can", []))


def test_record_ends_in_time_and_never_replaces_unasked(cli: Callable[..., Any], tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    assert cli("can", "record", path, "--for", 0.1, *VIRTUAL).code == 0
    assert path.read_bytes() == b""
    path.write_text("mine")
    got = cli("can", "record", path, "--for", 0.1, *VIRTUAL)
    assert got.code == 1
    assert "--overwrite" in got.err
    assert path.read_text() == "mine"
    assert cli("can", "record", path, "--for", 0.1, "--overwrite", *VIRTUAL).code == 0
    assert path.read_bytes() == b""


def test_a_bus_that_fails_leaves_what_was_recorded(
    cli: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from can.interfaces.virtual import VirtualBus

    came: list[can.Message | OSError] = [can.Message(timestamp=1.0, arbitration_id=1, data=b"x"), OSError("unplugged")]

    def recv(self: object, timeout: float | None = None) -> can.Message:
        one = came.pop(0)
        if isinstance(one, OSError):
            raise one
        return one

    monkeypatch.setattr(VirtualBus, "recv", recv)
    path = tmp_path / "a.blf"
    got = cli("can", "record", path, *VIRTUAL)
    assert got.code == 1
    assert got.err == f"error: CAN bus failed: unplugged; {path} has the 1 frames until then\n"
    assert len(list(read_messages(path))) == 1


@pytest.mark.parametrize("name", ["a.csv", "a", "a.mf4.txt"])
def test_record_refuses_other_endings(cli: Callable[..., Any], tmp_path: Path, name: str) -> None:
    got = cli("can", "record", tmp_path / name, *VIRTUAL)
    assert got.code == 1
    assert "a log must end in .log, .asc, .blf, .trc, .mf4" in got.err
    assert list(tmp_path.iterdir()) == []


def test_replay_sends_the_log_and_says_how_late(cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path) -> None:
    made = write(tmp_path / "a.blf", 10)
    got = cli("can", "replay", tmp_path / "a.blf", "--speed", 2, *VIRTUAL)
    assert got.code == 0, got.err
    frames = taken(peer)
    assert [(one.arbitration_id, bytes(one.data)) for one in frames] == [
        (one.arbitration_id, bytes(one.data)) for one in made
    ]
    assert f"sent {len(made)} frames" in got.out
    assert "later than recorded: p50 " in got.out


def test_replay_of_some_identifiers(cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path) -> None:
    write(tmp_path / "a.log", 5)
    got = cli("can", "replay", tmp_path / "a.log", "--only", "130, 18FEF100", *VIRTUAL)
    assert {one.arbitration_id for one in taken(peer)} == {0x130, 0x18FEF100}
    assert "sent 10 frames" in got.out
    assert "; 10 left out" in got.out


def test_replay_in_a_loop_goes_on_until_stopped(
    cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from can_bridge.tools.raw_bus import RawBus

    write(tmp_path / "a.log", 2)
    send = RawBus.send_message
    stop = []

    def counted(self: RawBus, message: can.Message, *, timeout_s: float = 0.1) -> None:
        send(self, message, timeout_s=timeout_s)
        stop.append(message)

    monkeypatch.setattr(RawBus, "send_message", counted)
    monkeypatch.setattr(
        "stillwake.commands.can.log.until_stopped", lambda: _stops_when(lambda: len(stop) >= 3 * 2 * PER_PERIOD)
    )
    got = cli("can", "replay", tmp_path / "a.log", "--loop", "--speed", 10, *VIRTUAL)
    assert got.code == 0, got.err
    assert len(taken(peer)) == 3 * 2 * PER_PERIOD
    assert ", round 3" in got.out


class _stops_when:  # noqa: N801  (stands for a function)
    def __init__(self, is_stopped: Callable[[], bool]) -> None:
        self._is_stopped = is_stopped

    def __enter__(self) -> Callable[[], bool]:
        return self._is_stopped

    def __exit__(self, *_: object) -> None: ...


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["missing.log"], "missing.log: there is no such file"),
        (["empty.log"], "empty.log: holds no CAN frame"),
        (["back.log"], "back.log: time goes back at frame 2 (001), from 2.000000 to 1.000000 s"),
        (["cut.blf"], "cut.blf: "),
        (["good.log", "--only", "zz"], "--only zz: must be identifiers in hexadecimal"),
        (["good.log", "--only", "7ff"], "holds no CAN frame to send among its 4"),
        (["good.log", "--speed", "0"], "--speed 0: must be a number above 0"),
        (["good.log", "--speed", "1e-9"], "the replay would take"),
        (["good.txt"], "a log must end in"),
    ],
)
def test_replay_refuses_before_anything_is_sent(
    cli: Callable[..., Any],
    peer: can.BusABC,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: list[str],
    error: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("good.log"), 1)
    write(Path("cut.blf"), 100)
    Path("cut.blf").write_bytes(Path("cut.blf").read_bytes()[:-100])
    Path("empty.log").touch()
    Path("back.log").write_text("(2.0) can0 001#\n(1.0) can0 001#\n")
    got = cli("can", "replay", *words, *VIRTUAL)
    assert got.code == 1
    assert error in got.err
    assert got.err.count("\n") == 1
    assert taken(peer) == []


def test_decode_prints_a_line_a_frame_and_a_summary(cli: Callable[..., Any], tmp_path: Path) -> None:
    write(tmp_path / "a.log", 3)
    got = cli("can", "decode", tmp_path / "a.log")
    assert got.code == 0, got.err
    lines = got.out.splitlines()
    assert lines[1].startswith("(1700000000.008000) 130 JetCommand: E2E_CRC=")
    assert lines[1].endswith("Flow=0 m2/s, PressureCounter=0  [E2E OK]")
    assert lines[3] == "(1700000000.012000) 18FEF100 unknown: 00 00 00 00 00 00 00 00"
    assert "130 JetCommand 3 50.00 0.008000 0.048000 0 OK 3" in flat(got.out)
    assert "12 data frames, 0 remote, 0 error frames in 0.052000 s from 1700000000.000000; load of the bus" in got.out
    assert cli("can", "decode", tmp_path / "a.log", "--summary").out.splitlines()[0].strip() == ""


def test_decode_finds_what_was_lost_repeated_and_damaged(cli: Callable[..., Any], tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    write(path, 10)
    lines = [line for line in path.read_text().splitlines() if " 130##" in line]
    damaged = lines[3].replace("130##1", "130##1F", 1).replace(" R", "")
    kept = [lines[0], lines[2], lines[2], f"{damaged[:-1]} R", lines[4]]
    path.write_text("\n".join(kept) + "\n")
    got = cli("can", "decode", path, "--json", tmp_path / "a.json")
    assert got.code == 0, got.err
    (message,) = json.loads((tmp_path / "a.json").read_text())["figures"]["messages"]
    assert message["checks"] == {"OK": 1, "some lost": 2, "repeated": 1, "CRC wrong": 1}
    assert message["lost"] == 2


def test_decode_writes_a_row_for_every_signal(cli: Callable[..., Any], tmp_path: Path) -> None:
    write(tmp_path / "a.blf", 2)
    got = cli("can", "decode", tmp_path / "a.blf", "--csv", tmp_path / "a.csv", "--summary")
    assert got.code == 0, got.err
    with (tmp_path / "a.csv").open(newline="") as file:
        found = list(csv.DictReader(file))
    flows = [row for row in found if row["signal"] == "Flow"]
    assert [(row["time_s"], row["id"], row["e2e"], float(row["value"]), row["unit"]) for row in flows] == [
        ("1700000000.008000", "130", "OK", 0.0, "m2/s"),
        ("1700000000.028000", "130", "OK", pytest.approx(0.1), "m2/s"),
    ]
    unknown = [row for row in found if row["id"] == "18FEF100"]
    assert [row["text"] for row in unknown] == ["00" * 8, "01" * 8]
    again = cli("can", "decode", tmp_path / "a.blf", "--csv", tmp_path / "a.csv")
    assert again.code == 1
    assert "--overwrite" in again.err


def test_decode_with_another_dbc(cli: Callable[..., Any], tmp_path: Path) -> None:
    write(tmp_path / "a.log", 1)
    (tmp_path / "o.dbc").write_text(
        'VERSION ""\nNS_ :\nBS_:\nBU_: A\nBO_ 2566844672 Engine: 8 A\n SG_ Load : 0|8@1+ (1,-125) [0|0] "%" A\n'
    )
    got = cli("can", "decode", tmp_path / "a.log", "--dbc", tmp_path / "o.dbc")
    assert "18FEF100 Engine: Load=-125 %" in got.out
    assert "JetCommand: E2E_CRC=" in got.out
    assert cli("can", "decode", tmp_path / "a.log", "--dbc", DBC).code == 0


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["missing.log"], "missing.log: there is no such file"),
        (["empty.log"], "empty.log: holds no CAN frame"),
        (["empty.blf"], "empty.blf: cannot be read as a CAN log"),
        (["cut.blf"], "cut.blf: "),
        (["cut.asc"], "cut.asc: "),
        (["good.log", "--dbc", "empty.blf"], "empty.blf: cannot be read as a DBC"),
        (["good.log", "--dbc", "missing.dbc"], "missing.dbc: there is no such file"),
        (["good.log", "--csv", "good.log"], "is one of the files to read"),
        (["good.log", "--csv", "folder"], "it is a directory"),
        (["good.log", "--json", "folder"], "it is a directory"),
        (["good.log", "--set", "bus.interface=virtual"], "`can decode` does not use it"),
        (["folder"], "a log must end in"),
    ],
)
def test_decode_refuses_in_one_line_and_writes_nothing(
    cli: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], error: str
) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("good.log"), 1)
    for name in ("cut.blf", "cut.asc"):
        write(Path(name), 100)
        Path(name).write_bytes(Path(name).read_bytes()[:-100])
    for name in ("empty.log", "empty.blf"):
        Path(name).touch()
    Path("folder").mkdir()
    before = sorted(path.name for path in tmp_path.iterdir())
    got = cli("can", "decode", "--summary", *words, *(() if "--csv" in words else ("--csv", "out.csv")))
    assert got.code == 1
    assert error in got.err
    assert got.err.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_monitor_of_a_log_shows_its_end(cli: Callable[..., Any], tmp_path: Path) -> None:
    write(tmp_path / "a.asc", 20)
    got = cli("can", "monitor", "--log", tmp_path / "a.asc")
    assert got.code == 0, got.err
    # The last frame is 3.5 ms behind the last status: 0.00 s old by the log's clock, at 50 a second.
    assert "EcuStatus 140 0.00 50.0 0 0 OK" in flat(got.out)
    assert "Missed 19" in flat(got.out)
    assert "80 frames, 0 lost, 0 refused" in got.out
    only = cli("can", "monitor", "--log", tmp_path / "a.asc", "--filter", "flow", "--once").out
    assert "Flow 1.9 m2/s" in flat(only)
    assert "Missed" not in only


def test_monitor_of_a_bus_prints_lines_and_a_table(cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path) -> None:
    made = write(tmp_path / "a.log", 5)
    thread = threading.Thread(target=_send_when_heard, args=(peer, made))
    thread.start()
    got = cli("can", "monitor", "--for", 1.5, *VIRTUAL)
    thread.join()
    assert got.code == 0, got.err
    assert "1 s: 20 data frames of 4 messages, 0 lost, 0 refused, 0 remote or error frames" in got.out
    assert "20 frames, 0 lost, 0 refused   virtual test-can" in got.out


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["--log", "missing.log"], "missing.log: there is no such file"),
        (["--log", "empty.log"], "empty.log: holds no CAN frame"),
        ([], "that bus exists within a run only"),
        (["--speed", "2"], "--speed: goes with --log"),
        (["--log", "empty.log", "--speed", "-1"], "--speed -1: must be a number above 0"),
        (["--for", "inf"], "--for inf: must be a number above 0"),
        (["--dbc", "missing.dbc"], "missing.dbc: there is no such file"),
        (["--set", "bus.interface=nonsense"], "nonsense"),
    ],
)
def test_monitor_refuses_in_one_line(
    cli: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], error: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("empty.log").touch()
    got = cli("can", "monitor", *words)
    assert got.code == 1
    assert error in got.err
    assert got.err.count("\n") == 1


def test_outside_the_main_thread_nothing_stops_the_work() -> None:
    answers: list[bool] = []

    def work() -> None:
        with until_stopped() as is_stopped:
            answers.append(is_stopped())

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert answers == [False]
