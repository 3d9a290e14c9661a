"""What is written is read back, by python-can's own readers too; what is damaged is refused by name."""

import gc
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import can
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from can_bridge.logs.frame_log import loss_of, recording_messages
from can_bridge.logs.log_reader import read_messages
from contract.errors import BusError
from tests.can_bridge.can_messages import can_messages
from tests.examples import examples
from tests.refused import refused

FORMATS = (".log", ".asc", ".blf", ".trc")
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
    with recording_messages(path) as append:
        for message in log:
            append(message)


def expected(path: Path, log: list[can.Message]) -> list[can.Message]:
    """What the format keeps, by what `loss_of` reports."""
    kept = []
    for message in log:
        loss = loss_of(path, message)
        if loss == "data lengths of remote frames":
            message.dlc = 0
        if loss != "error frames":
            kept.append(message)
    return kept


HAS_ASAMMDF = find_spec("asammdf") is not None
MF4 = pytest.param(
    ".mf4",
    # asammdf takes a quarter of a second to make and read a file.
    marks=[pytest.mark.slow, pytest.mark.skipif(not HAS_ASAMMDF, reason="asammdf is not installed")],
)


def in_order(log: list[can.Message], suffix: str) -> list[can.Message]:
    """Data, remote and error frames are three tables in an MF4: among equal times their order is not kept."""
    return sorted(log, key=lambda one: (round(one.timestamp * 1e6), repr(identity(one)))) if suffix == ".mf4" else log


@pytest.mark.parametrize("suffix", [*FORMATS, MF4])
@examples(40, suppress_health_check=list(HealthCheck))
@given(log=logs())
@pytest.mark.slow
def test_what_is_written_is_read_back_and_by_python_can_alone_too(tmp_path_factory, suffix, log):
    path = tmp_path_factory.mktemp("log") / f"frames{suffix}"
    write(path, log)
    data = [one for one in log if not (one.is_error_frame or one.is_remote_frame)]
    kept, got = in_order(expected(path, log), suffix), in_order(list(read_messages(path)), suffix)
    assert [identity(one) for one in got] == [identity(one) for one in kept]
    if got:
        times, wanted = [one.timestamp for one in got], [one.timestamp for one in kept]
        zero = (times[0], wanted[0]) if suffix == ".asc" else (0.0, 0.0)
        assert [t - zero[0] for t in times] == pytest.approx([t - zero[1] for t in wanted], abs=RESOLUTION_S, rel=0)
    if suffix != ".mf4":
        with can.LogReader(path) as reader:
            # Its ASC reader takes an FD frame without data for a remote one; its TRC reader leaves an FD frame's length
            # code in place of the length, and the bytes are right.
            theirs = [one for one in reader if not one.is_error_frame and (not one.is_remote_frame or one.is_fd)]
        facts = [
            [(one.arbitration_id, one.is_extended_id, one.is_fd, bytes(one.data)) for one in frames]
            for frames in (theirs, data)
        ]
        assert facts[0] == facts[1]


def test_trc_types_are_those_of_pcan(tmp_path):
    """PEAK, "PCAN trace file format", version 2.1: FE is the error state alone, BI both flags."""
    path = tmp_path / "a.trc"
    flags = [(False, False), (True, False), (False, True), (True, True)]
    log = [can.Message(is_fd=True, bitrate_switch=brs, error_state_indicator=esi) for brs, esi in flags]
    write(path, [can.Message(), *log, can.Message(is_remote_frame=True)])
    lines = [line for line in path.read_text().splitlines() if not line.startswith(";")]
    assert [line.split()[2] for line in lines] == ["DT", "FD", "FB", "FE", "BI", "RR"]
    assert str(path) in path.read_text()


def one_log(path: Path) -> None:
    write(path, [can.Message(timestamp=1.0 + i / 1000, arbitration_id=i, data=bytes(8)) for i in range(40)])


def test_damage_is_named_in_one_line(tmp_path):
    unreadable = "cannot be read as a CAN log"
    for suffix, damage, words in [
        (".blf", lambda content: content[: len(content) // 2], f"is cut off|{unreadable}"),
        (".blf", lambda content: b"", unreadable),
        (".blf", lambda content: b"PK" + content[2:], unreadable),
        (".asc", lambda content: content[: len(content) // 2], "no End TriggerBlock|bytes announced"),
        (".asc", lambda content: content[: content.rindex(b"00")], "bytes announced|no End TriggerBlock"),
        (".log", lambda content: content[:-20], f"{unreadable}|its last line has no end"),
        (".log", lambda content: b"\xff\xfe\x00", unreadable),
        (".log", lambda content: content.replace(b"1.003000", b"nan"), "frame 4: time nan s, must be within"),
        (".log", lambda content: content.replace(b"1.003000", b"1e300"), "frame 4: time 1e.300 s, must be within"),
        (
            ".log",
            lambda content: content.replace(b" 00000003#", b" FFFFFFFFFF#"),
            "line 4: identifier FFFFFFFFFF,",
        ),
        (".trc", lambda content: content[:-10], f"{unreadable}|its last line has no end"),
    ]:
        path = tmp_path / f"a{suffix}"
        one_log(path)
        path.write_bytes(damage(path.read_bytes()))
        with refused(BusError, rf"a\{suffix}: .*({words})") as caught:
            list(read_messages(path))
        assert "\n" not in str(caught.value), (suffix, words)


def test_every_cut_is_an_error_or_ends_between_two_frames(tmp_path):
    """The line formats have no end that could be missing: cut between two lines, the file is a shorter log."""
    for suffix in [".blf", ".asc", ".trc", ".log"]:
        path = tmp_path / f"a{suffix}"
        one_log(path)
        content = path.read_bytes()
        whole = [identity(one) for one in read_messages(path)]
        for cut in range(0, len(content), 211):
            path.write_bytes(content[:cut])
            got = []
            try:
                for one in read_messages(path):
                    got.append(identity(one))
            except BusError:
                pass
            else:
                assert suffix in (".trc", ".log") or len(got) in (0, len(whole)), suffix
            assert got == whole[: len(got)], suffix


def test_other_files_are_refused_by_name(tmp_path):
    (tmp_path / "folder.log").mkdir()
    (tmp_path / "a.csv").touch()
    for name, words in (
        ("a.csv", r"a\.csv: a log must end in \.log, \.asc, \.blf, \.trc, \.mf4"),
        ("a", "a log must end in"),
        ("missing.blf", "there is no such file"),
        ("folder.log", "is a directory"),
    ):
        with refused(BusError, words):
            list(read_messages(tmp_path / name))


def test_mf4_without_asammdf_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr("can_bridge.logs.log_reader.find_spec", lambda name: None)
    (tmp_path / "a.mf4").touch()
    with pytest.raises(BusError, match=r"a\.mf4: MF4 needs asammdf: pip install '\.\[mf4\]' in a checkout"):
        list(read_messages(tmp_path / "a.mf4"))
    with pytest.raises(BusError, match="needs asammdf"), recording_messages(tmp_path / "b.mf4"):
        pytest.fail("must not get here")


@pytest.mark.skipif(not HAS_ASAMMDF, reason="asammdf is not installed")
def test_a_damaged_mf4_is_one_line(tmp_path, capfd, monkeypatch):
    """asammdf prints tracebacks of its own, and its half-made object fails again when it is deleted."""
    path = tmp_path / "a.mf4"
    frames = [can.Message(timestamp=EPOCH_S + i / 100, arbitration_id=0x120, data=[i] * 8) for i in range(200)]
    write(path, frames)
    content = path.read_bytes()
    failed: list[Any] = []
    monkeypatch.setattr("sys.unraisablehook", failed.append)
    block = content.rindex(b"##DZ") + 60
    for damaged in (
        content[: len(content) // 2],
        content[:block] + bytes([content[block] ^ 0x81]) + content[block + 1 :],
    ):
        path.write_bytes(damaged)
        with refused(BusError, r"a\.mf4: cannot be read as a CAN log") as caught:
            list(read_messages(path))
        assert "\n" not in str(caught.value)
        del caught
        gc.collect()
        assert (failed, capfd.readouterr()) == ([], ("", ""))
