import can
import pytest

from can_bridge.bus.backends.python_can import from_message
from can_bridge.logs.frame_log import recording
from can_bridge.wire.frame import Frame
from contract.errors import StillwakeError

FRAMES = [
    Frame(frame_id=0x120, data=bytes(range(16)), timestamp_ns=20_000_000),
    Frame(frame_id=0x7E0, data=b"\x02\x10\x03", timestamp_ns=20_123_000, is_fd=False),
    Frame(frame_id=0x130, data=bytes(8), timestamp_ns=28_000_000),
    Frame(frame_id=0x140, data=b"", timestamp_ns=10**12, is_fd=False),
]


def record(path, frames):
    with recording(path) as append:
        for frame in frames:
            append(frame)


@pytest.mark.parametrize("ending", [".log", ".asc", ".blf"])
def test_python_can_reads_back_what_was_recorded(tmp_path, ending):
    path = tmp_path / "runs" / f"frames{ending}"
    record(path, FRAMES)
    reader = can.LogReader(path)
    found = [from_message(message) for message in reader]
    reader.stop()
    read = [frame for frame in found if frame is not None]
    assert len(read) == len(found)
    assert [(frame.frame_id, frame.data, frame.is_fd) for frame in read] == [
        (frame.frame_id, frame.data, frame.is_fd) for frame in FRAMES
    ]
    # The Vector formats count from the first frame, to the microsecond or better.
    got = [frame.timestamp_ns - read[0].timestamp_ns for frame in read]
    assert got == pytest.approx([frame.timestamp_ns - FRAMES[0].timestamp_ns for frame in FRAMES], abs=1000)
    assert [item.name for item in path.parent.iterdir()] == [path.name]


def test_candump_text_is_exactly_this(tmp_path):
    record(tmp_path / "frames.log", FRAMES[:2])
    assert (tmp_path / "frames.log").read_text() == (
        "(0.020000) vcan0 120##1000102030405060708090A0B0C0D0E0F R\n(0.020123) vcan0 7E0#021003 R\n"
    )


@pytest.mark.parametrize("ending", [".log", ".asc", ".blf"])
@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_interrupted_recording_leaves_no_file(tmp_path, ending, error):
    with pytest.raises(error), recording(tmp_path / f"frames{ending}") as append:
        append(FRAMES[0])
        raise error
    assert list(tmp_path.iterdir()) == []


def test_recording_of_nothing_is_an_empty_log(tmp_path):
    record(tmp_path / "frames.log", [])
    assert (tmp_path / "frames.log").read_text() == ""


@pytest.mark.parametrize("name", ["frames.csv", "frames", "frames.LOG.txt"])
def test_other_endings_are_refused_by_name(tmp_path, name):
    with (
        pytest.raises(StillwakeError, match=rf"{name}: name must end in \.log, \.asc, \.blf"),
        recording(tmp_path / name),
    ):
        pytest.fail("must not get here")


def test_unwritable_place_is_named(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(StillwakeError, match=r"file/frames\.log"):
        record(tmp_path / "file" / "frames.log", [])
