"""What a node hears while nothing usable arrives, in one line; and frames as python-can's messages."""

from collections import Counter
from dataclasses import replace
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.conversion import frame_of, to_message
from can_bridge.bus.heard import Heard, Silence, line
from can_bridge.bus.interface import Rejection
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import CLASSIC, FD, SECURED
from tests.can_bridge.can_messages import frames
from tests.each import each


@each(
    "messages, ids, rejected, expected",
    [
        (FD, {}, {}, "no frame arrives: there is no ECU on this bus, or bus.channel is wrong"),
        # Its own frames, which some interfaces hear again, are nothing.
        (FD, {0x120: 16}, {"OWN": 50}, "no frame arrives"),
        (FD, {0x131: 8, 0x141: 8}, {}, "the other node uses the messages for classic CAN: --set bus.frames=classic"),
        (CLASSIC, {0x130: 8}, {}, "the other node uses the messages for CAN FD: --set bus.frames=fd"),
        (FD, {0x132: 24, 0x142: 48}, {}, "for CAN FD, authenticated: it has a key, --set bus.key=FILE"),
        (SECURED, {0x130: 8}, {}, "the other node uses the messages for CAN FD: --set bus.frames=fd"),
        (FD, {0x130: 12}, {}, "its frames have 12 bytes, not 8, so the ECU has another DBC"),
        (FD, {0x130: 8}, {}, "50 frames arrived, but their MAC, counter or CRC is wrong: another DBC, or two nodes"),
        (SECURED, {0x132: 24}, {}, "50 frames arrived, but their MAC, counter or CRC is wrong: another bus.key or DBC"),
        (CLASSIC, {}, {"WRONG_FORMAT": 100}, "do not use bus.frames = classic: --set bus.frames=fd"),
        (FD, {0x200: 8, 0x201: 8}, {}, "there is no ECU; only other nodes send: 0x200, 0x201"),
        (FD, dict.fromkeys(range(0x300, 0x309), 8), {}, "0x300, 0x301, 0x302, 0x303 and 5 more"),
        (FD, {}, {"GARBAGE": 7, "EXTENDED": 3}, "frames cannot be used: 7 unreadable, 3 29-bit identifier"),
    ],
)
def test_the_line_names_the_cause_and_what_would_do(messages, ids, rejected, expected) -> None:
    """The line for frames of these identifiers and lengths, fifty each."""
    heard = Heard()
    for frame_id, length in ids.items():
        heard.add([Frame(frame_id=frame_id, data=bytes(length), is_fd=messages is not CLASSIC)] * 50)
    reasons = Counter(dict.fromkeys(Rejection, 0) | {Rejection[name]: count for name, count in rejected.items()})
    text = line(heard, messages.command.spec, messages, reasons, sender="ECU")
    assert text.startswith(f"no usable {messages.command.spec.name} (0x{messages.command.spec.frame_id:03x}) in 1 s: ")
    assert expected in text
    assert "\n" not in text


def test_a_silence_is_reported_once_with_what_is_new_in_it() -> None:
    lines: list[str] = []
    silence = Silence(FD.pressure.spec, FD, "vehicle", lines.append)
    wrong = {Rejection.WRONG_FORMAT: 50}
    for usable, rejected in ((0, wrong), (0, wrong), (3, wrong), (3, wrong), (4, wrong)):
        silence.look(usable, Heard(), rejected)
    opening = "no usable Pressure (0x120) in 1 s: "
    assert lines == [
        f"{opening}the other nodes do not use bus.frames = fd: --set bus.frames=classic",
        "usable Pressure frames arrive",
        f"{opening}no frame arrives: there is no vehicle on this bus, or bus.channel is wrong",
        "usable Pressure frames arrive",
    ]


# Twelve days: as far as a time in float seconds is exact to the ns.
@given(frame=frames(), time_ns=st.integers(0, 10**15))
def test_frame_survives_the_conversion(frame, time_ns):
    frame = replace(frame, timestamp_ns=time_ns)
    message = to_message(frame)
    message._check()
    assert message.bitrate_switch == message.is_fd == frame.is_fd
    assert frame_of(message) == frame


def test_frames_that_come_while_the_line_is_made_are_no_error() -> None:
    class Growing(Heard):
        def items(self) -> Any:
            for item in super().items():
                yield item
                self[0x7FF, len(self)] += 1

    lines: list[str] = []
    Silence(FD.pressure.spec, FD, "vehicle", lines.append).look(0, Growing({(0x200, 8): 1}), {})
    assert [text.endswith("only other nodes send: 0x200") for text in lines] == [True]
