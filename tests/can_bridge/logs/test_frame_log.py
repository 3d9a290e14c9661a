import pytest

from can_bridge.logs.frame_log import recording
from can_bridge.wire.frame import Frame
from contract.errors import StillwakeError
from tests.refused import refused

FRAMES = [
    Frame(frame_id=0x120, data=bytes(range(16)), timestamp_ns=20_000_000),
    Frame(frame_id=0x7E0, data=b"\x02\x10\x03", timestamp_ns=20_123_000, is_fd=False),
]


def record(path, frames):
    with recording(path) as append:
        for frame in frames:
            append(frame)


def test_candump_text_is_exactly_this(tmp_path):
    record(tmp_path / "frames.log", FRAMES)
    assert (tmp_path / "frames.log").read_text() == (
        "(0.020000) vcan0 120##1000102030405060708090A0B0C0D0E0F R\n(0.020123) vcan0 7E0#021003 R\n"
    )


def test_interrupted_recording_leaves_no_file(tmp_path):
    with pytest.raises(KeyboardInterrupt), recording(tmp_path / "frames.log") as append:
        append(FRAMES[0])
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_a_place_where_no_log_can_be_is_named(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with refused(StillwakeError, r"file/frames\.log"):
        record(tmp_path / "file" / "frames.log", [])
