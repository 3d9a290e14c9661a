"""What python-can writes is read back; what is damaged is refused by name."""

from contextlib import suppress
from pathlib import Path

import can
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from can_bridge.logs.log_reader import read_messages
from contract.errors import BusError
from tests.can_bridge.can_messages import can_messages
from tests.examples import examples
from tests.refused import refused

FORMATS = (".asc", ".blf", ".trc", ".log")
RESOLUTION_S = 2e-6
"""The text formats write whole microseconds; a double holds times since the epoch to 0.24 us."""
EPOCH_S = 1_700_000_000


error_frames = st.builds(can.Message, is_error_frame=st.just(True))


@st.composite
def logs(draw: st.DrawFn) -> list[can.Message]:
    """In the order of time, with gaps of a microsecond to an hour."""
    log = draw(st.lists(can_messages() | error_frames, min_size=1, max_size=12))
    t = EPOCH_S + draw(st.integers(0, 10**6)) / 1e6
    for message in log:
        message.timestamp = t
        t += draw(st.integers(0, 3_600_000_000)) / 1e6
    return log


def identity(message: can.Message) -> tuple[object, ...]:
    """All but time and channel; of an error frame, that it is one."""
    if message.is_error_frame:
        return ("error",)
    return (
        *(message.arbitration_id, message.is_extended_id, message.is_remote_frame, message.is_fd, message.is_rx),
        *(message.bitrate_switch, message.error_state_indicator, message.dlc, bytes(message.data)),
    )


def write(path: Path, log: list[can.Message]) -> None:
    with can.Logger(path) as writer:
        for message in log:
            writer.on_message_received(message)


def expected(suffix: str, log: list[can.Message]) -> list[can.Message]:
    """What python-can's writer keeps: its TRC has classic data frames alone, candump no length of remote frames."""
    kept = []
    for message in log:
        if message.is_remote_frame and suffix == ".log":
            message.dlc = 0
        if suffix != ".trc" or not (message.is_error_frame or message.is_remote_frame or message.is_fd):
            kept.append(message)
    return kept


@examples(40, suppress_health_check=list(HealthCheck))
@given(log=logs())
@pytest.mark.slow
def test_what_python_can_writes_is_read_back(tmp_path_factory, log):
    for suffix in FORMATS:
        path = tmp_path_factory.mktemp("log") / f"frames{suffix}"
        kept = expected(suffix, log)
        write(path, kept)
        got = list(read_messages(path))
        assert [identity(one) for one in got] == [identity(one) for one in kept], suffix
        if got:
            times, wanted = [one.timestamp for one in got], [one.timestamp for one in kept]
            zero = (times[0], wanted[0]) if suffix == ".asc" else (0.0, 0.0)
            assert [t - zero[0] for t in times] == pytest.approx([t - zero[1] for t in wanted], abs=RESOLUTION_S, rel=0)


def test_trc_types_are_those_of_pcan(tmp_path):
    """PEAK, "PCAN trace file format", version 2.1: FE is the error state alone, BI both flags; lengths are codes."""
    types = ("DT", "FD", "FB", "FE", "BI", "RR")
    lines = [f"{n:>7} {n:13.3f} {kind} 1 0123 Rx - 9 {'11 ' * 12}".rstrip() for n, kind in enumerate(types[1:5], 2)]
    lines = ["      1         1.000 DT 1 0123 Rx - 2 11 22", *lines, "      6         6.000 RR 1 0123 Rx - 3"]
    head = ";$FILEVERSION=2.1\n;$STARTTIME=45000.0\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n"
    path = tmp_path / "a.trc"
    path.write_text(head + "".join(f"{line}\n" for line in lines))
    got = list(read_messages(path))
    flags = [(one.is_fd, one.bitrate_switch, one.error_state_indicator) for one in got[1:5]]
    assert flags == [(True, False, False), (True, True, False), (True, False, True), (True, True, True)]
    assert [(one.dlc, len(one.data)) for one in got[:5]] == [(2, 2), *[(12, 12)] * 4]
    assert [one.is_remote_frame for one in got] == [False] * 5 + [True]


def one_log(path: Path) -> Path:
    write(path, [can.Message(timestamp=1.0 + i / 1000, arbitration_id=i, data=bytes(8)) for i in range(40)])
    return path


def test_damage_is_named_in_one_line(tmp_path):
    unreadable = "cannot be read as a CAN log"
    time_of_4, no_time = b"1.003000", "frame 4: time {} s, must be within"
    for suffix, damage, words in [
        (".blf", lambda content: content[: len(content) // 2], f"is cut off|{unreadable}"),
        (".blf", lambda content: b"", unreadable),
        (".blf", lambda content: b"PK" + content[2:], unreadable),
        (".asc", lambda content: content[: content.rindex(b"00")], "bytes announced|no End TriggerBlock"),
        (".log", lambda content: content[:-20], f"{unreadable}|its last line has no end"),
        (".log", lambda content: b"\xff\xfe\x00", unreadable),
        (".log", lambda content: content.replace(time_of_4, b"nan"), no_time.format("nan")),
        (".log", lambda content: content.replace(time_of_4, b"1e300"), no_time.format("1e.300")),
        (".log", lambda content: content.replace(b" 00000003#", b" FFFFFFFFFF#"), "line 4: identifier FFFFFFFFFF,"),
        (".trc", lambda content: content[:-10], f"{unreadable}|its last line has no end"),
    ]:
        path = one_log(tmp_path / f"a{suffix}")
        path.write_bytes(damage(path.read_bytes()))
        with refused(BusError, rf"a\{suffix}: .*({words})") as caught:
            list(read_messages(path))
        assert "\n" not in str(caught.value), (suffix, words)


def test_every_cut_is_an_error_or_ends_between_two_frames(tmp_path):
    """The line formats have no end that could be missing: cut between two lines, the file is a shorter log."""
    for suffix in [".blf", ".asc", ".trc", ".log"]:
        path = one_log(tmp_path / f"a{suffix}")
        content = path.read_bytes()
        whole = [identity(one) for one in read_messages(path)]
        for cut in range(0, len(content), 211):
            path.write_bytes(content[:cut])
            got = []
            with suppress(BusError):
                for one in read_messages(path):
                    got.append(identity(one))
                assert suffix in (".trc", ".log") or len(got) in (0, len(whole)), suffix
            assert got == whole[: len(got)], suffix


def test_other_files_are_refused_by_name(tmp_path):
    (tmp_path / "folder.log").mkdir()
    (tmp_path / "a.csv").touch()
    for name, words in (
        ("a.csv", r"a\.csv: a log must end in \.log, \.asc, \.blf, \.trc; "),
        ("a.mf4", r"`python -m can\.logconvert` makes one of another format"),
        ("a", "a log must end in"),
        ("missing.blf", "there is no such file"),
        ("folder.log", "is a directory"),
    ):
        with refused(BusError, words):
            list(read_messages(tmp_path / name))
