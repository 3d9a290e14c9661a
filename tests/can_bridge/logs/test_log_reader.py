"""What python-can writes is read back with nothing lost; damage is named in one line."""

from contextlib import suppress
from pathlib import Path

import can
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from can_bridge.logs.candump_log import recording
from can_bridge.logs.log_reader import CanLog
from can_bridge.wire.frame import Frame
from contract.errors import BusError
from tests.can_bridge.can_messages import can_messages
from tests.can_bridge.logs.log_texts import EPOCH_S, RESOLUTION_S, frames, identity, write
from tests.examples import examples
from tests.refused import refused

error_frames = st.builds(can.Message, is_error_frame=st.just(True))


@st.composite
def logs(draw: st.DrawFn) -> list[can.Message]:
    """Frames in the order of time, with gaps of a microsecond to an hour."""
    log = draw(st.lists(can_messages() | error_frames, min_size=1, max_size=12))
    t = EPOCH_S + draw(st.integers(0, 10**6)) / 1e6
    for message in log:
        message.timestamp = t
        t += draw(st.integers(0, 3_600_000_000)) / 1e6
    return log


def expected(suffix: str, log: list[can.Message]) -> list[can.Message]:
    """What python-can's writer keeps: its TRC has classic data frames alone, candump no length of remote frames."""
    kept = []
    for message in log:
        if message.is_remote_frame and suffix == ".log":
            message.dlc = 0
        if suffix != ".trc" or not (message.is_error_frame or message.is_remote_frame or message.is_fd):
            kept.append(message)
    return kept


@examples(20, suppress_health_check=list(HealthCheck))
@given(log=logs())
@pytest.mark.slow
def test_what_python_can_writes_is_read_back(tmp_path_factory, log):
    for suffix in (".asc", ".blf", ".trc", ".log", ".csv", ".db"):
        path = tmp_path_factory.mktemp("log") / f"frames{suffix}"
        kept = expected(suffix, log)
        write(path, kept)
        got = list(CanLog(path))
        read, wrote = ([identity(one) for one in some] for some in (got, kept))
        if suffix in (".csv", ".db"):  # they state neither format nor direction
            read, wrote = ([one[:3] + one[7:] for one in some] for some in (read, wrote))
        assert read == wrote, suffix
        if got:
            times, wanted = [one.timestamp for one in got], [one.timestamp for one in kept]
            zero = (times[0], wanted[0]) if suffix == ".asc" else (0.0, 0.0)
            assert [t - zero[0] for t in times] == pytest.approx([t - zero[1] for t in wanted], abs=RESOLUTION_S, rel=0)


def one_log(path: Path) -> Path:
    write(path, [can.Message(timestamp=1.0 + i / 1000, arbitration_id=i, data=bytes(8)) for i in range(40)])
    return path


def test_damage_is_named_in_one_line(tmp_path):
    unreadable = "cannot be read as a CAN log"
    for suffix, damage, words in [
        (".blf", lambda content: b"PK" + content[2:], unreadable),
        (".asc", lambda content: content[: content.rindex(b"00")], "bytes are announced|no End TriggerBlock"),
        (".asc", lambda content: content.replace(b" d 8 00", b" d 8 0", 1), "8 bytes are announced, but 7 are present"),
        (".asc", lambda content: content.replace(b" Rx ", b" ", 1), "line 6: .* has neither Rx nor Tx"),
        (".asc", lambda content: content.replace(b"1.003", b"1,003", 1).replace(b"0.003000 1", b"0,003 1"), "line 9: "),
        (".log", lambda content: b"\xff\xfe\x00", unreadable),
        (".log", lambda content: content.replace(b"1.003000", b"nan"), "frame 4 is at nan s: must be within"),
        (".log", lambda content: content.replace(b" 00000003#", b" FFFFFFFFFF#"), "line 4: identifier FFFFFFFFFF must"),
        (".log", lambda content: content.replace(b"#0000", b"#zz00", 1), "line 1: 'zz0000.*' is not the data of a"),
        (".log", lambda content: b"nonsense\n" + content, "line 1: 'nonsense' is not a line of candump"),
        (
            ".csv",
            lambda content: content.replace(b",8,AAAAAAAAAAA=", b",10,AAAAAAAAAAAAAA==", 1),
            "line 2: no CAN FD frame has 10 bytes",
        ),
        (".trc", lambda content: content.replace(b" DT ", b" XY ", 1), "line 19: 'XY' is not a frame type"),
        (".trc", lambda content: content.replace(b",I,", b",X,", 1), r"columns 'N,O,T,B,X,.* must have O"),
        (".trc", lambda content: content.replace(b"=2.1", b"=3.0", 1), "line 1: version '3.0' must be 1.0, 1.1"),
    ]:
        path = one_log(tmp_path / f"a{suffix}")
        path.write_bytes(damage(path.read_bytes()))
        with refused(BusError, rf"a\{suffix}: .*({words})") as caught:
            list(CanLog(path))
        assert "\n" not in str(caught.value), (suffix, words)


def test_every_cut_is_an_error_or_ends_between_two_frames(tmp_path):
    """The line formats have no end that could be missing: cut between two lines, the file is a shorter log."""
    for suffix in [".blf", ".asc", ".trc", ".log"]:
        path = one_log(tmp_path / f"a{suffix}")
        content = path.read_bytes()
        whole = [identity(one) for one in CanLog(path)]
        for cut in range(0, len(content), 211):
            path.write_bytes(content[:cut])
            got = []
            with suppress(BusError):
                for one in CanLog(path):
                    got.append(identity(one))
                assert suffix in (".trc", ".log") or len(got) in (0, len(whole)), suffix
            assert got == whole[: len(got)], suffix


def test_other_files_are_refused_by_name(tmp_path):
    (tmp_path / "folder.log").mkdir()
    (tmp_path / "a.csv").write_text("name,x,y\n")
    for name, words in (
        ("a.txt", r"a\.txt: a log must end in \.log, \.asc, \.blf, \.trc, \.mf4, \.mcap, \.csv, \.db, or"),
        ("a", r"`python -m can\.logconvert` converts other formats"),
        ("a.db.gz", "unpack it first"),
        ("a.csv", "cannot be read as a CAN log .its head is none|line 1: 'name,x,y' must be timestamp,arbitration_id"),
        ("missing.blf", "there is no such file"),
        ("folder.log", "is a directory"),
    ):
        with refused(BusError, words):
            list(CanLog(tmp_path / name))


def test_candump_text_is_exactly_this(tmp_path):
    with recording(tmp_path / "frames.log") as append:
        append(Frame(frame_id=0x120, data=bytes(range(16)), timestamp_ns=20_000_000))
        append(Frame(frame_id=0x7E0, data=b"\x02\x10\x03", timestamp_ns=20_123_000, is_fd=False))
    assert (tmp_path / "frames.log").read_text() == (
        "(0.020000) vcan0 120##1000102030405060708090A0B0C0D0E0F R\n(0.020123) vcan0 7E0#021003 R\n"
    )


def test_a_table_shows_can_fd_only_by_message_and_length(tmp_path):
    for suffix in (".csv", ".db"):
        read = CanLog(write(tmp_path / f"a{suffix}", frames()))
        assert [one.is_fd for one in read] == [one.is_fd for one in frames()], suffix
