"""The commands that write a bus to a file and back: `stillwake can record|replay`."""

import time
from pathlib import Path
from typing import Annotated, Final

import typer

from contract.errors import BusError, ConfigError
from stillwake.commands.can.options import BUS, Duration, identifiers, positive
from stillwake.console.bus_option import BusName, with_bus
from stillwake.console.outputs import Overwrite, check_output
from stillwake.console.progress import now_and_then
from stillwake.console.settings import settings
from stillwake.console.stopping import until_stopped
from stillwake.console.terminal import ConfigFile, Overrides, console, progress_bar

MOST_WAITING: Final = 10_000
"""Frames that are still taken after a stop: more than the queues of the system and of interfaces hold, and an end."""
LEAD_IN_NS: Final = 100_000_000
"""From the opening of the bus to a replay's first frame."""


def record(
    output: Annotated[Path, typer.Argument(help="Log to write: .log (candump), .asc, .blf, .trc or .mf4.")],
    seconds: Duration = None,
    frames: Annotated[int | None, typer.Option(help="End after so many frames.", metavar="N", min=1)] = None,
    overwrite: Overwrite = False,
    bus_name: BusName = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Write every frame of a bus to a file, until Ctrl-C, SIGTERM, --for or --frames.

    Data, remote and error frames of all identifiers are written, CAN FD and
    classic. The file appears when the recording ends, and is whole. If the bus
    fails, what came until then is kept. .mf4 needs asammdf.
    """
    from can_bridge.logs.frame_log import loss_of, recording_messages
    from can_bridge.logs.log_reader import check_suffix
    from can_bridge.tools.raw_bus import open_bus
    from can_bridge.tools.recorder import Recorder

    config = settings("can record", config_file, with_bus(bus_name, overrides), uses=BUS).config.bus
    if seconds is not None:
        positive("--for", seconds)
    check_suffix(output)
    check_output(output, overwrite=overwrite)
    failure = ""
    with open_bus(config) as bus, recording_messages(output) as append, until_stopped() as is_stopped:
        recorder = Recorder(append=append, loss_of=lambda message: loss_of(output, message))
        begin = time.monotonic()
        with progress_bar("s" if frames is None else "frames") as bar:
            task = bar.add_task(f"recording {output.name}", total=seconds if frames is None else frames, note="")
            shown = begin

            def is_over(count: int) -> bool:
                nonlocal shown
                now = time.monotonic()
                if now - shown >= 0.2:
                    shown = now
                    done = round(now - begin, 1) if frames is None else count
                    bar.update(task, completed=done, note=f"{count} frames")
                return (
                    is_stopped()
                    or (frames is not None and count >= frames)
                    or (seconds is not None and now - begin >= seconds)
                )

            try:
                recorder.run(bus.receive_message, is_over=is_over)
                if is_stopped():
                    recorder.drain(
                        bus.receive_message, most=MOST_WAITING if frames is None else frames - recorder.frames
                    )
            except BusError as error:
                failure = str(error)
        rejected = bus.rejected
    console.print(
        f"wrote {output}: {recorder.frames} frames, {output.stat().st_size} bytes", soft_wrap=True, highlight=False
    )
    for what, count in sorted(recorder.not_kept.items()):
        console.print(f"note: {output.suffix} does not keep {what}: {count}", soft_wrap=True, highlight=False)
    if rejected:
        console.print(f"note: {rejected} receptions could not be read", soft_wrap=True, highlight=False)
    if failure:
        raise BusError(f"{failure}; {output} has the {recorder.frames} frames until then")


def replay(
    file: Annotated[Path, typer.Argument(help="Log: .log (candump), .asc, .blf, .trc or .mf4.", show_default=False)],
    speed: Annotated[float, typer.Option(help="Recorded seconds in one.")] = 1.0,
    only: Annotated[
        str | None, typer.Option(help="Identifiers to send, in hexadecimal, e.g. 120,130.", metavar="IDS")
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Begin again at the end, until Ctrl-C or SIGTERM.")] = False,
    bus_name: BusName = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Send a recorded log on a bus, in step with the recording's clock.

    Each frame is due at a time counted from the first one, so that no delay
    adds up. Ends with how late the frames were sent. Error frames are left
    out. A log whose times go back is refused before anything is sent.
    """
    from can_bridge.logs.log_reader import check_suffix, read_messages
    from can_bridge.tools.raw_bus import open_bus
    from can_bridge.tools.replay import Replayed, span_of
    from can_bridge.tools.replay import replay as send_all

    config = settings("can replay", config_file, with_bus(bus_name, overrides), uses=BUS).config.bus
    positive("--speed", speed)
    wanted = None if only is None else identifiers("--only", only)
    check_suffix(file)
    span = span_of(str(file), read_messages(file), wanted)
    if span.span_s / speed > 1e7:
        raise ConfigError(f"--speed {speed:g}: the replay would take {span.span_s / speed:.3g} s, must be up to 1e7")
    done, rounds = Replayed(), 0
    with open_bus(config) as bus, until_stopped() as is_stopped, progress_bar("frames") as bar:
        task = bar.add_task(f"replaying {file.name}", total=None if loop else span.frames, note="")
        # The first frame is due when it has been read.
        begin_ns = time.monotonic_ns() + LEAD_IN_NS
        while not is_stopped():
            done = send_all(
                read_messages(file),
                bus.send_message,
                span=span,
                only=wanted,
                speed=speed,
                start_ns=begin_ns + round(rounds * span.round_s * 1e9 / speed),
                clock_ns=time.monotonic_ns,
                sleep=time.sleep,
                so_far=done,
                progress=now_and_then(lambda sent: bar.update(task, completed=sent)),
                is_over=is_stopped,
            )
            rounds += 1
            if not loop:
                break
        bar.update(task, completed=done.sent)
    is_cut_short = not loop and done.sent < span.frames
    console.print(
        f"sent {done.sent} frames of {file} in {(time.monotonic_ns() - begin_ns) / 1e9:.3f} s"
        + (f", round {rounds}" if loop else "")
        + (f"; {span.left_out} left out" if span.left_out else "")
        + (f"; {span.frames - done.sent} not sent" if is_cut_short else ""),
        soft_wrap=True,
        highlight=False,
    )
    console.print(
        f"later than recorded: p50 {done.late_ms(0.5):.3f} ms, p99 {done.late_ms(0.99):.3f} ms, "
        f"max {done.late_ms(1.0):.3f} ms",
        soft_wrap=True,
        highlight=False,
    )
    if is_cut_short:
        raise KeyboardInterrupt
