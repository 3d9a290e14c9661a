from can_bridge.logs.frame_log import recording
from can_bridge.wire.frame import Frame


def test_candump_text_is_exactly_this(tmp_path):
    with recording(tmp_path / "frames.log") as append:
        append(Frame(frame_id=0x120, data=bytes(range(16)), timestamp_ns=20_000_000))
        append(Frame(frame_id=0x7E0, data=b"\x02\x10\x03", timestamp_ns=20_123_000, is_fd=False))
    assert (tmp_path / "frames.log").read_text() == (
        "(0.020000) vcan0 120##1000102030405060708090A0B0C0D0E0F R\n(0.020123) vcan0 7E0#021003 R\n"
    )
