"""Every notation of a log that its writers have, line by line: frames, and what is counted by its name."""

import gzip
import struct
import zlib
from datetime import timedelta, timezone
from itertools import product
from pathlib import Path

import can
import pytest

from can_bridge.logs.entries import error_class
from can_bridge.logs.log_reader import CanLog
from contract.errors import BusError
from tests.can_bridge.logs.log_texts import RESOLUTION_S, asc, candump, candump_l, frames, identity, trc
from tests.refused import refused


def written(path: Path, lines: list[str], *, encoding: str = "utf-8", end: str = "\n", last: bool = True) -> CanLog:
    text = end.join(lines) + (end if last else "")
    packed = gzip.compress if path.suffix == ".gz" else bytes
    path.write_bytes(packed(text.encode(encoding)))
    return CanLog(path)


def check(log: CanLog, messages: list[can.Message], what: object, *, shift_s: float = 0.0, lines: int = 0) -> None:
    """The log holds these data frames; and each of its lines is one, an error frame, or counted by its name."""
    got = list(log)
    data = [one for one in got if not one.is_error_frame]
    sent, read = ([identity(one)[:4] + identity(one)[7:] for one in some] for some in (messages, data))
    assert read == sent, what
    wanted = [one.timestamp + shift_s for one in messages]
    assert [one.timestamp for one in data] == pytest.approx(wanted, abs=RESOLUTION_S, rel=0), what
    if lines:
        assert len(got) + log.events.total() == lines, what


def test_an_asc_is_read_in_every_combination_of_what_its_writers_do(tmp_path):
    sent = frames()
    for case in product(*[(False, True)] * 7):
        names = ("decimal", "relative", "symbolic", "requests", "events", "before", "block")
        options = dict(zip(names, case, strict=True))
        shift_s = -0.9 if options.pop("before") else 0.0
        requests, events = options["requests"], options["events"]
        lines = asc(sent, shift_s=shift_s, **options)
        log = written(tmp_path / "a.asc", lines)
        check(log, sent, case, shift_s=shift_s, lines=len(lines))
        assert log.events["transmit request"] == (6 if requests else 0), case
        assert {"status", "statistics", "system variable", "trigger", "overload frame"} <= set(log.events) or not events
    lines = asc(sent, events=True)
    for encoding, end, last in (("utf-8-sig", "\n", True), ("cp1252", "\r\n", True), ("utf-16", "\r\n", False)):
        text = ["// Prüfstand Süd", *lines]
        check(written(tmp_path / "a.asc", text, encoding=encoding, end=end, last=last), sent, encoding, lines=len(text))
    check(written(tmp_path / "b.asc.gz", lines), sent, "gz")


def test_lines_of_vectors_own_description_are_what_it_says(tmp_path):
    """ "CAN, Log & Trigger ASC Logging Format" 1.4, by its grammar; names of messages are made up."""
    line_and_meaning: list[tuple[str, object]] = [
        ("2.5 1 64 Rx d 8 00 01 02 03 04 05 06 07 Length = 1 BitCount = 2 ID = 100", (0x64, False, False, 8, True)),
        ("2.5 1 18EBFF00x Tx d 8 01 A0 0F A6 60 3B D1 40", (0x18EBFF00, True, False, 8, False)),
        ("2.5 2 3FF Tx d D 55 AA 01 02 03 04 05 06 Length = 1 BitCount = 9 ID = 1023", (0x3FF, False, False, 8, False)),
        ("2.5 1 Engine Rx d 1 05 Length = 0 BitCount = 0 ID = 1023", (0x3FF, False, False, 1, True)),
        (
            "2.5 CANFD 3 Rx 30a Generic_12 1 1 8 8 01 02 03 04 05 06 07 08 1 3 303000 e 4 4 2 2",
            (0x30A, False, True, 8, True),
        ),
        ("2.5 CANFD 3 Rx 30a 0 0 8 8 01 02 03 04 05 06 07 08 1 133 200000 e 4 4 2 2", (0x30A, False, False, 8, True)),
        ("2.5 CANFD 3 Rx 30a 0 0 f 8 01 02 03 04 05 06 07 08 1 133 200000 e 4 4 2 2", (0x30A, False, False, 8, True)),
        ("2.5 CANFD 1 Rx 7 Face 0 0 0 0 1 133 1000 e 4 4 2 2", (7, False, True, 0, True)),
        ("2.5 CANFD 3 Tx 50005x 0 1 5 0 140000 73 200050 7a60 4 4 2 2", ("remote", 5)),
        ("2.5 1 100 Rx r", ("remote", 0)),
        ("2.5 3 200 Tx r Length = 1704000 BitCount = 145 ID = 88888888x", ("remote", 0)),
        ("2.5 4 300 Rx r 8 Length = 1704000 BitCount = 145 ID = 88888888x", ("remote", 8)),
        ("2.5 1 ErrorFrame", "error"),
        ("2.5 1 ErrorFrame ECC: 10100010", "error"),
        (
            "2.5 CANFD 5 Tx ErrorFrame Not Acknowledge error, dominant error flag fffe c7 31ca Arb. 556 44 0 0 f",
            "error",
        ),
        ("2.5 1 Engine Rx d 1 05", "frame with a name that stillwake does not use"),
        ("2.5 CANFD 1 Rx Face 1 0 2 2 01 02 1 133 3000 e 4 4 2 2", "frame with a name that stillwake does not use"),
        ("2.5 1 J1939TP FEE3p 6 0 0 - Rx d 23 A0 0F A6", "J1939 transport"),
        ("2.5 CAN 2 Status:chip status warning level - TxErr: 132 RxErr: 0", "status"),
        ("2.5 log trigger event", "trigger"),
        ("2.5 EnvWind := 3", "environment variable"),
        ("2.5 \xd6ltemperatur := 3", "environment variable"),
        ("2.5 CAN 1 Gateway::Engine::Speed = 3", "signal"),
        ("2.5 TFS: [1,2] test case begins", "test step"),
        ("2.5 Comment: 0 the rig was moved", "comment"),
        ("2.5 0 ffffff 0 GMGroup: a GMMarker: b GMDescription: c", "marker"),
        ("//2.5 previous log file: a.asc", "comment"),
    ]
    for line, meaning in line_and_meaning:
        log = written(tmp_path / "a.asc", ["base hex  timestamps absolute", "no internal events logged", f" {line}"])
        read = [
            "error" if one.is_error_frame
            else ("remote", one.dlc) if one.is_remote_frame
            else (one.arbitration_id, one.is_extended_id, one.is_fd, len(one.data), one.is_rx)
            for one in log
        ]  # fmt: skip
        assert read == [meaning] or (read, log.events[str(meaning)]) == ([], 1), line
    wrong = ["1 120 Rx", "1 120 d 8 00", "CANFD 1 Rx 120 1 0 a 12 00", "%", "1 Pressure d"]
    for line in ("End", *(f"2.5 {rest}" for rest in wrong)):
        with refused(BusError, r"line 2: "):
            list(written(tmp_path / "a.asc", ["2.4 1 64 Rx d 0", line]))


def test_trigger_blocks_lie_on_one_clock(tmp_path):
    """Two blocks a day and a bit apart: times that begin again are moved by the blocks' dates, in any language."""
    sent = frames(4)
    first, second = asc(sent)[:-1], asc(sent)[4:]
    # Times of one measurement go on through its blocks, whatever their dates say.
    going_on = asc(sent, shift_s=100.0)[5:]
    for day, later, shift_s in (("28 10:01", second[1:], 86_460.0), ("27 10:00", going_on, 100.0)):
        lines = [*first, "End TriggerBlock", second[0].replace("27 10:00", day).replace("Fri", "ven."), *later]
        moved = [*sent, *frames(4)]
        for one in moved[4:]:
            one.timestamp += shift_s
        check(written(tmp_path / "a.asc", lines), moved, day, lines=len(lines))
    with refused(BusError, "its time goes back .* at a trigger block, but the block's date"):
        list(written(tmp_path / "a.asc", [*first, "End TriggerBlock", second[0].replace("Nov", "nov."), *second[1:]]))


def test_candump_is_read_from_a_file_and_from_a_screen(tmp_path):
    sent = frames()
    for what, lines in (
        ("-L", candump_l(sent)),
        ("-L -x", [f"{line} R" for line in candump_l(sent)]),
        ("-t a", candump(sent, "a")),
        ("-t A", candump(sent, "A")),
        ("-t a -x", candump(sent, "a", extra="  RX B -")),
        ("-t a -a", candump(sent, "a", tail="   '........'")),
        ("-t a -c", [f"\x1b[31m{line}\x1b[0m" for line in candump(sent, "a")]),
    ):
        log = written(tmp_path / "a.log", list(lines))
        check(log, sent, what, lines=len(sent))
        assert log.is_local is (what == "-t A")
    check(written(tmp_path / "a.log", list(candump(sent, "z"))), sent, "-t z", shift_s=-0.25)
    zone = timezone(timedelta(hours=2))
    written(tmp_path / "b.log", list(candump(sent, "A")))
    check(CanLog(tmp_path / "b.log", zone=zone), sent, "zone", shift_s=-7200.0)
    # Differences of one length, and of two, as a bus has them.
    unequal = frames()
    for k, one in enumerate(unequal):
        one.timestamp += 0.004 * (k % 2)
    for these, times, text in (
        (sent, "d", "14 of 16 frames are not later than the previous frame: .*candump -t d"),
        (unequal, "d", "goes back from .*candump -t d.*; record with `candump -L`"),
        (sent, "", "line 1: it has no time: record"),
    ):
        with refused(BusError, text):
            list(written(tmp_path / "a.log", list(candump(these, times))))


def test_error_frames_of_linux_are_known_by_bit_29_and_named_by_their_class(tmp_path):
    """linux/can/error.h."""
    names = "transmit timeout,arbitration lost,controller,protocol,transceiver,no acknowledgement,bus off,bus error"
    classes = {1 << bit: name for bit, name in enumerate(f"{names},restarted,error counters".split(","))}
    classes |= {0x88: "protocol and bus error", 0: "not stated"}
    lines = [f"(1.{k:06d}) can0 {0x20000000 | one:08X}#0004000000000000" for k, one in enumerate(classes)]
    screen = [f" {line.split('#')[0]}   [2]  00 04   ERRORFRAME" for line in lines]
    explained = [text for line in screen for text in (line, "\tcontroller-problem{rx-error-warning}")]
    for text in (lines, screen, explained):
        log = written(tmp_path / "a.log", text)
        assert [error_class(one) for one in log if one.is_error_frame] == list(classes.values())
        assert log.messages + log.events.total() == len(text)
    other = ["(1.0) can0 123#R4", "(1.1) can0 123##0", "(1.2) can0 123###00", "(1.3) can0 123#11.22_9", "# a comment"]
    log = written(tmp_path / "a.log", other)
    read = [(one.is_remote_frame, one.is_fd, one.dlc) for one in log]
    assert read == [(True, False, 4), (False, True, 0), (False, False, 2)]
    assert log.events == {"CAN XL frame": 1, "comment": 1}


def test_peaks_traces_of_every_version_are_read(tmp_path):
    """PEAK, "PEAK CAN TRC File Format" (2020): its columns, and its lines that are no frames."""
    for version in ("1.0", "1.1", "1.2", "1.3", "2.0", "2.1"):
        sent = [one for one in frames() if one.is_fd is False or version[0] == "2"]
        lines = trc(sent, version)
        for encoding, end, last in (("utf-8", "\r\n", True), ("cp1252", "\n", False)):
            text = [*lines[:-1], ";   Prüfstand", lines[-1]]
            log = written(tmp_path / "a.trc", text, encoding=encoding, end=end, last=last)
            check(log, sent, version, lines=len(text))
            assert log.is_local is (version != "1.0")
    for head, line, name in (
        ([], "     2)      1842  0008  4  ERROR 00 19 08 08", "protocol"),
        ([], "     2)     17540  FFFFFFFF  4  00 00 00 08 -- -- -- -- BUSHEAVY", "hardware status"),
        ([";$FILEVERSION=1.1"], "     2)     17540.3  Warng  FFFFFFFF  4  00 00 00 08  BUSHEAVY", "hardware status"),
        ([";$FILEVERSION=1.1"], "     2)     17540.3  Error      0008  4  00 19 08 08", "protocol"),
        ([";$FILEVERSION=1.3"], "     2)  17540.300 1  Warng FFFFFFFF -  4    00 00 00 08 BUSHEAVY", "hardware status"),
        (trc([], "2.0"), "      2     17540.300 ST          Rx    00 00 00 08", "hardware status"),
        (trc([], "2.0"), "      2     17540.300 ER          Rx    04 00 02 00 00", "protocol"),
        (trc([], "2.1"), "      2     17540.300 ER 1         - Rx -  5    04 00 02 00 00", "protocol"),
        (trc([], "2.1"), "      2     17540.300 EC 1         - Rx -  2    02 01", "error counters"),
        (trc([], "2.1"), "      2     17540.300 EV User-defined event", "user-defined event"),
        (trc([], "1.1"), "     2)      1842.1  Rx         0131  12  31 00 00 00 02 00 00 00", "8 bytes"),
        (trc([], "2.1"), "      2     17540.300 DT 1      0131 Rx -  15    31 00 00 00 02 00 00 00", "8 bytes"),
        (trc([], "2.1"), "      2         1.000 RR 1      0123 Rx -  3", "remote 3"),
    ):
        log = written(tmp_path / "a.trc", [*head, line])
        read = [
            error_class(one) if one.is_error_frame
            else f"remote {one.dlc}" if one.is_remote_frame
            else f"{len(one.data)} bytes"
            for one in log
        ]  # fmt: skip
        assert read == [name] or (read, log.events[name]) == ([], 1), line
    # FE is the error state alone, BI both flags; lengths are codes.
    lines = [f"{n:>7} {n:13.3f} {kind} 1 0123 Rx - 9 {'11 ' * 12}" for n, kind in enumerate(("FD", "FB", "FE", "BI"))]
    got = list(written(tmp_path / "a.trc", [*trc([], "2.1"), *lines]))
    flags = [(one.bitrate_switch, one.error_state_indicator) for one in got if one.is_fd and len(one.data) == 12]
    assert flags == [(False, False), (True, False), (False, True), (True, True)]


def blf(objects: list[tuple[int, bytes]], *, packed: bool = True) -> bytes:
    """A BLF after Vector's binlog_objects.h: a header, and objects with stamps of 1 ms, 2 ms, ... in one container."""
    inside = b""
    for k, (kind, body) in enumerate(objects, 1):
        head = struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, 32 + len(body), kind, 2, 0, 0, 1_000_000 * k)
        inside += head + body + bytes(len(body) % 4)
    content = zlib.compress(inside) if packed else inside
    container = struct.pack("<4sHHLLH6xL4x", b"LOBJ", 16, 1, 32 + len(content), 10, 2 if packed else 0, len(inside))
    rest = container + content + bytes((32 + len(content)) % 4)
    start = struct.pack("<8H", 2026, 11, 5, 27, 12, 0, 0, 0)
    return struct.pack("<4sL8xQQLL", b"LOGG", 144, 144 + len(rest), 0, 0, 0) + start + bytes(88) + rest


def test_objects_of_a_blf_are_frames_requests_and_events_by_their_names(tmp_path):
    data = bytes(range(1, 9))
    classic = [(1, struct.pack("<HBBL8s", 2, flags, 12, 0x123, data)) for flags in (0, 1, 2)]
    remote = (86, struct.pack("<HBBL8s8x", 2, 0x80, 3, 0x80000005, bytes(8)))
    fd = (100, struct.pack("<HBBLLBBB5x64s", 1, 0, 9, 0x120, 0, 0, 7, 12, bytes(range(12)) + bytes(52)))
    fd64 = [struct.pack("<BBBBLLL16xHBBL", 1, 9, 12, 0, 0x120, 0, 0x3000, 0, way, 0, 0) for way in (0, 2)]
    others = [(kind, bytes(16)) for kind in (4, 65, 91, 96, 31, 999)]
    errors = [(2, bytes([1, 0, 0, 0])), (73, bytes([1] + [0] * 31)), (104, bytes([1] + [0] * 47))]
    objects = [*classic, remote, fd, *((101, head + bytes(range(12))) for head in fd64), *others, *errors]
    for packed in (True, False):
        (tmp_path / "a.blf").write_bytes(blf(objects, packed=packed))
        log = CanLog(tmp_path / "a.blf", zone=timezone(timedelta(hours=2)))
        got = list(log)
        read = [(one.arbitration_id, one.dlc, bytes(one.data), one.is_fd, one.is_rx, one.channel) for one in got[:2]]
        assert read == [(0x123, 8, data, False, True, "2"), (0x123, 8, data, False, False, "2")]
        assert (got[2].is_remote_frame, got[2].is_extended_id, got[2].dlc) == (True, True, 3)
        both = [(bytes(one.data), one.bitrate_switch, one.error_state_indicator) for one in got[3:5]]
        assert both == [(bytes(range(12)), True, True), (bytes(range(12)), True, False)]
        assert [one.is_error_frame for one in got[5:]] == [True] * 3
        named = ("statistics", "text", "driver overrun", "marker", "driver error", "object of type 999")
        assert log.events == {"transmit request": 2, **dict.fromkeys(named, 1)}
        assert log.is_local
        assert got[0].timestamp == pytest.approx(1795773600.001)
