"""What it costs to receive and to send a block over ISO-TP, compared with the library can-isotp.

    python -m benchmarks isotp --json results/isotp.json

Time of the processor alone: no bus is in between, and neither side waits for the other. A block is the longest
TransferData request. The other end is the same in both cases: ours.
"""

import time
from collections import deque
from statistics import median
from typing import Annotated, Any, Final

import isotp
import typer
from rich.table import Table

from benchmarks.common.command_line import JsonFile, console, save, track
from can_bridge.isotp.endpoint import Endpoint
from can_bridge.isotp.settings import IsoTpSettings, classic
from can_bridge.uds.services import MAX_BLOCK, REQUEST_ID, RESPONSE_ID
from can_bridge.wire.frame import Frame
from contract.results import machine, versions

BLOCK: Final = bytes(index % 251 for index in range(MAX_BLOCK))
KINDS: Final = {
    "CAN FD": IsoTpSettings(receive_id=REQUEST_ID, send_id=RESPONSE_ID),
    "classic CAN": classic(receive_id=REQUEST_ID, send_id=RESPONSE_ID),
}


class _Library:
    """can-isotp with the calls of `Endpoint`."""

    def __init__(self, settings: IsoTpSettings) -> None:
        self._coming = deque[isotp.CanMessage]()
        self._going = list[Frame]()
        self._layer = isotp.TransportLayerLogic(
            rxfn=lambda timeout: self._coming.popleft() if self._coming else None,
            txfn=lambda message: self._going.append(
                Frame(frame_id=message.arbitration_id, data=bytes(message.data), is_fd=message.is_fd)
            ),
            address=isotp.Address(isotp.AddressingMode.Normal_11bits, txid=settings.send_id, rxid=settings.receive_id),
            params={
                "stmin": 0,
                "blocksize": 0,
                "can_fd": settings.is_fd,
                "tx_data_length": settings.frame_length,
                "tx_padding": 0xCC,
            },
        )

    def receive(self, now_ns: int, frame: Frame) -> None:
        self._coming.append(isotp.CanMessage(arbitration_id=frame.frame_id, data=frame.data, is_fd=frame.is_fd))

    def send(self, message: bytes) -> None:
        self._layer.send(message)

    def poll(self, now_ns: int) -> list[Frame]:
        self._layer.process()
        going, self._going = self._going, []
        return going

    def take(self) -> list[bytes]:
        message = self._layer.recv()
        return [] if message is None else [bytes(message)]


def measure(*, repeats: int = 101) -> dict[str, Any]:
    """Medians over the repeats, ours and theirs in turn.

    Returns:
        rows: for each kind of frame and direction the frames of a block, both ways, and both times in us.
    """
    times: dict[tuple[str, str, str], list[float]] = {}
    frames: dict[str, int] = {}
    for _ in track(range(repeats), "blocks", "block"):
        for kind, settings in KINDS.items():
            other = IsoTpSettings(
                receive_id=RESPONSE_ID,
                send_id=REQUEST_ID,
                frame_length=settings.frame_length,
                is_fd=settings.is_fd,
            )
            for name, make in (("stillwake", Endpoint), ("can_isotp", _Library)):
                received, frames[kind] = _seconds(make(settings), Endpoint(other), measured_sends=False)
                sent, _ = _seconds(make(settings), Endpoint(other), measured_sends=True)
                times.setdefault((kind, "receive", name), []).append(received)
                times.setdefault((kind, "send", name), []).append(sent)
    rows = []
    for kind in KINDS:
        for direction in ("receive", "send"):
            ours, theirs = (median(times[kind, direction, name]) * 1e6 for name in ("stillwake", "can_isotp"))
            rows.append(
                {
                    "frames": kind,
                    "direction": direction,
                    "frames_of_a_block": frames[kind],
                    "stillwake_us": ours,
                    "can_isotp_us": theirs,
                    "ratio": theirs / ours,
                }
            )
    return {"block_bytes": MAX_BLOCK, "rows": rows}


def _seconds(measured: Endpoint | _Library, other: Endpoint, *, measured_sends: bool) -> tuple[float, int]:
    """Time of the processor in the measured end until the block is across, and frames both ways."""
    spent, count = 0.0, 0
    if measured_sends:
        measured.send(BLOCK)
    else:
        other.send(BLOCK)
    while True:
        start = time.process_time()
        going = measured.poll(0)
        messages = measured.take()
        spent += time.process_time() - start
        for frame in going:
            other.receive(0, frame)
        coming = other.poll(0)
        messages += other.take()
        count += len(going) + len(coming)
        start = time.process_time()
        for frame in coming:
            measured.receive(0, frame)
        spent += time.process_time() - start
        if messages:
            if messages != [BLOCK]:
                raise ValueError("another block came than was sent")
            return spent, count


def main(
    repeats: Annotated[int, typer.Option(min=1, help="Blocks of each kind.")] = 101, json_file: JsonFile = None
) -> None:
    """What it costs to receive and to send a block over ISO-TP, compared with can-isotp."""
    figures = measure(repeats=repeats)
    shown = Table("frames", "direction", "frames of a block", "stillwake, us", "can-isotp, us", "times as fast")
    for row in figures["rows"]:
        shown.add_row(
            row["frames"],
            row["direction"],
            str(row["frames_of_a_block"]),
            f"{row['stillwake_us']:.0f}",
            f"{row['can_isotp_us']:.0f}",
            f"{row['ratio']:.1f}",
        )
    console.print(shown)
    save(
        json_file,
        figures=figures,
        facts={"settings": {"repeats": repeats}, "machine": machine(), "versions": versions("can-isotp")},
    )
