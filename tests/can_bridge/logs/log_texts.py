"""One log in the notations of the field, written after the formats' own descriptions, and by nothing of ours."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import can

LENGTHS = [*range(9), 12, 16, 20, 24, 32, 48, 64]
NAMES = {0x120: "Pressure", 0x128: "VehicleSpeed", 0x130: "JetCommand", 0x140: "EcuStatus"}
OTHERS = (
    *("CAN 1 Status:chip status error active", "1  Statistic: D 2 R 0 XD 0 XR 0 E 0 O 0 B 0.04%"),
    *("SV: 2 0 1 ::Rig::Wind = 3", "log direct start (0ms)", "1  OverloadFrame"),
)
"""Lines of an ASC that are no frames."""
RESOLUTION_S = 2e-6
"""The text formats write whole microseconds; a double holds times since the epoch to 0.24 us."""
EPOCH_S = 1_700_000_000
DATE = "Fri Nov 27 10:00:00.000 2026"


def frames(count: int = 16) -> list[can.Message]:
    """Messages of our CAN FD set, 5 ms apart from 0.25 s on; every fifth is another node's, classic, of 29 bits."""
    made = []
    for k in range(count):
        if k % 5 == 4:
            one = can.Message(arbitration_id=0x18FEF100, is_extended_id=True, data=bytes([k] * 6))
        else:
            frame_id, length = ((0x120, 16), (0x128, 8), (0x130, 8), (0x140, 24))[k % 5]
            data = bytes((7 * k + j) % 256 for j in range(length))
            one = can.Message(arbitration_id=frame_id, is_extended_id=False, is_fd=True, bitrate_switch=True, data=data)
        one.timestamp = 0.25 + 0.005 * k
        made.append(one)
    return made


def asc_line(one: can.Message, direction: str, *, decimal: bool, symbolic: bool) -> str:
    """All but its time; of a channel of CAN FD where the frame is one, else of a classic channel."""
    number = f"{one.arbitration_id}" if decimal else f"{one.arbitration_id:x}"
    shown = " ".join(str(byte) if decimal else f"{byte:02X}" for byte in one.data)
    ident = f"{number}{'x' if one.is_extended_id else ''}"
    if symbolic and one.arbitration_id in NAMES:
        ident = NAMES[one.arbitration_id]
    if not one.is_fd:
        return f"1  {ident:<15} {direction:<4} d {one.dlc} {shown}  Length = 0 BitCount = 0 ID = 419361024x"
    code = f"{LENGTHS.index(one.dlc)}" if decimal else f"{LENGTHS.index(one.dlc):x}"
    return f"CANFD   1 {direction:<4} {ident:>10}  {'':<28} 1 0 {code} {one.dlc:2d} {shown}  0    0     3000 0 0 0 0 0"


def asc(
    messages: Sequence[can.Message],
    *,
    decimal: bool = False,
    relative: bool = False,
    symbolic: bool = False,
    requests: bool = False,
    events: bool = False,
    shift_s: float = 0.0,
    block: bool = True,
) -> list[str]:
    """Its lines: `requests` puts a request before each frame of the ECU, `events` something else behind every frame."""
    timed: list[tuple[float, str]] = []
    for k, one in enumerate(messages):
        line = partial(asc_line, one, decimal=decimal, symbolic=symbolic)
        time_s, is_ours = one.timestamp + shift_s, one.arbitration_id in (0x130, 0x140)
        if requests and is_ours:
            timed.append((time_s - 1e-4, line("TxRq")))
        timed.append((time_s, line("Tx" if is_ours and requests else "Rx")))
        if events:
            timed.append((time_s, OTHERS[k % len(OTHERS)]))
    before, body = 0.0, []
    for time_s, rest in timed:
        body.append(f"{time_s - before if relative else time_s:11.6f} {rest}")
        before = time_s
    base = f"base {'dec' if decimal else 'hex'}  timestamps {'relative' if relative else 'absolute'}"
    head = [f"date {DATE}", base]
    start = ["internal events logged", "// version 9", f"Begin Triggerblock {DATE}", "   0.0 Start of measurement"]
    return [*head, *start, *body, "End TriggerBlock"] if block else [*head, *body]


def candump_l(messages: Sequence[can.Message], channel: str = "can0") -> Iterator[str]:
    for one in messages:
        number = f"{one.arbitration_id:08X}" if one.is_extended_id else f"{one.arbitration_id:03X}"
        data = bytes(one.data).hex().upper()
        yield f"({one.timestamp:017.6f}) {channel} {number}#{'#1' if one.is_fd else ''}{data}"


def candump(messages: Sequence[can.Message], times: str, *, extra: str = "", tail: str = "") -> Iterator[str]:
    """Lines of candump on a screen: `times` is its option -t; `extra` what -x puts before the identifier."""
    first = before = messages[0].timestamp
    for one in messages:
        number = f"{one.arbitration_id:08X}" if one.is_extended_id else f"{one.arbitration_id:03X}"
        length = f"[{one.dlc:02d}]" if one.is_fd else f"[{one.dlc}]"
        seconds = {"a": one.timestamp, "z": one.timestamp - first, "d": one.timestamp - before}.get(times, 0.0)
        stamp = {"": "", "A": f" (1970-01-01 00:00:{one.timestamp:09.6f})"}.get(times, f" ({seconds:010.6f})")
        yield f"{stamp}  can0{extra}  {number:>5}  {length:>4}  {one.data.hex(' ').upper()}{tail}"
        before = one.timestamp


def trc(messages: Sequence[can.Message], version: str) -> list[str]:
    """Lines of PEAK's programs; those before 2.0 have no frames of CAN FD."""
    lines = []
    for k, one in enumerate(messages, 1):
        number = f"{one.arbitration_id:08X}" if one.is_extended_id else f"{one.arbitration_id:04X}"
        data, ms = one.data.hex(" ").upper(), 1e3 * one.timestamp
        kind, code = ("FB" if one.is_fd else "DT"), LENGTHS.index(one.dlc)
        lines.append(
            {
                "1.0": f"{k:6d}) {ms:9.3f}  {number:>8}  {one.dlc}  {data}",
                "1.1": f"{k:6d}) {ms:11.3f}  Rx     {number:>8}  {one.dlc}  {data}",
                "1.2": f"{k:6d}) {ms:11.3f} 1  Rx     {number:>8}  {one.dlc}  {data}",
                "1.3": f"{k:6d}) {ms:11.3f} 1  Rx     {number:>8} -  {one.dlc}    {data}",
                "2.0": f"{k:7d} {ms:13.3f} {kind} {number:>8} Rx {one.dlc:2d}  {data}",
                "2.1": f"{k:7d} {ms:13.3f} {kind} 1  {number:>8} Rx -  {code:2d}    {data}",
            }[version]
        )
    columns = {"2.0": [";$COLUMNS=N,O,T,I,d,l,D"], "2.1": [";$COLUMNS=N,O,T,B,I,d,R,L,D"]}.get(version, [])
    head = [] if version == "1.0" else [f";$FILEVERSION={version}", ";$STARTTIME=25569", *columns]
    return [*head, ";", *lines]


def identity(message: can.Message) -> tuple[object, ...]:
    """All but time and channel; of an error frame, that it is one."""
    if message.is_error_frame:
        return ("error",)
    return (
        *(message.arbitration_id, message.is_extended_id, message.is_remote_frame, message.is_fd, message.is_rx),
        *(message.bitrate_switch, message.error_state_indicator, message.dlc, bytes(message.data)),
    )


def write(path: Path, messages: Sequence[can.Message]) -> Path:
    """A log in the format of its ending, by python-can."""
    with can.Logger(path) as writer:
        for message in messages:
            writer.on_message_received(message)
    return path
