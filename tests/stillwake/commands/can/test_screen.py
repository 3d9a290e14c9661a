"""The picture of the live view: whole at 80 columns, what fails in red."""

from io import StringIO

import can
from rich.console import Console
from rich.text import Text

from can_bridge.bus.conversion import to_message
from can_bridge.tools.summary import Summary
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import SPECS
from contract.config.vehicle import BusConfig
from stillwake.commands.can.monitor_screen import STALE_S, line, screen
from tests.can_bridge.tools.test_observed_traffic import frame


def summary_of(*frames: Frame) -> Summary:
    summary = Summary(config=BusConfig())
    for one in frames:
        summary.add(to_message(one))
    return summary


def everything() -> Summary:
    """All twelve messages, one of them out of sequence, one that is not known, and an error frame."""
    known = [frame(spec, counter, t_ns=counter * 20_000_000) for spec in SPECS for counter in (0, 1, 8)]
    summary = summary_of(*known, Frame(frame_id=0x18FEF100, data=bytes(64), is_extended=True))
    summary.add(can.Message(is_error_frame=True))
    return summary


def picture(summary: Summary, width: int, now_s: float = 0.0) -> str:
    console = Console(file=StringIO(), width=width, force_terminal=True, color_system="standard", record=True)
    console.print(screen(summary, now_s, source="virtual x", matching="", width=width))
    return console.export_text(styles=True)


def test_it_is_whole_at_80_columns():
    lines = [one.rstrip() for one in Text.from_ansi(picture(everything(), 80)).plain.rstrip().splitlines()]
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    for spec in SPECS:
        assert f"\n{spec.name} " in text
    assert "PressureCounterValid" in text
    # Three frames, the last six ahead: one wrong sequence, six lost.
    (command,) = (one for one in lines if one.startswith("JetCommand "))
    assert command.split()[:2] == ["JetCommand", "130"]
    assert command.split()[-4:] == ["6", "1", "wrong", "sequence"]
    # Where no terminal is: twelve messages that each lost six and had one out of sequence, and an unknown one.
    said = "2 s: 37 data frames of 13 messages, 72 lost, 12 refused, 1 remote or error frames"
    assert line(everything(), 2.0) == said


def test_what_a_receiver_refuses_is_red_and_what_is_old_is_dim():
    once = frame(SPECS[0], 0)
    assert "\x1b[31mrepeated" in picture(summary_of(once, once), 100)
    fresh = picture(summary_of(once), 100)
    assert "\x1b[31m" not in fresh and "\x1b[2m" not in fresh
    assert "\x1b[2m" in picture(summary_of(once), 100, now_s=STALE_S + 0.1)
