"""An emulated board on a real bus. The board's time follows the wall clock, but stops while a step is emulated."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

from can_bridge.bus.interface import Bus
from contract.atomic import replacing
from contract.errors import McuError
from contract.release.signing import PublicKey
from firmware_sim.mcu.board.board_ecu import BoardEcu
from firmware_sim.mcu.board.flash_controller import FlashBank


def equipment_header(root: PublicKey, access_key: bytes, vehicle: bytes, hardware: str, serial: str) -> bytes:
    """Return the header that enables the loader. `root` checks key lists, and `access_key` is the key of security
    access, 16 bytes. `vehicle` is `contract.release.controller_image.ImageFacts.vehicle` of every image for this
    vehicle. `hardware` and `serial` of the board are printable ASCII without quotes."""
    numbers = {"ROOT": root.raw, "ACCESS_KEY": access_key, "VEHICLE": vehicle}
    found = {name: "{" + ", ".join(map(str, value)) + "}" for name, value in numbers.items()} | {
        "LOADER": "1", "HARDWARE": f'"{hardware}"', "SERIAL": f'"{serial}"', "SOFTWARE": '"board"',
    }  # fmt: skip
    return "".join(f"#define SW_BOARD_{name} {value}\n" for name, value in found.items()).encode()


LONGEST_UNSEEN_NS: Final = 20_000_000
"""Longest advance in ns between two reads of the bus. With a slower emulation, the board's time falls behind."""


def read_bank(path: Path) -> FlashBank:
    """Read the flash from a file; return an erased bank if there is no file. Raises McuError for an unreadable file."""
    try:
        return FlashBank.unpack(path.read_bytes()) if path.exists() else FlashBank()
    except OSError as error:
        raise McuError(f"{path}: {error.strerror or error}") from error


def serve(
    ecu: BoardEcu,
    bus: Bus,
    path: Path,
    *,
    clock_ns: Callable[[], int],
    wait: Callable[[], None],
    is_stopped: Callable[[], bool],
) -> None:
    """Run the board until `is_stopped` is true, with a `wait` between two reads of the bus. Write the flash to the file
    after each change. Raises BusError if the bus failed; McuError if the core stopped."""
    kept, before_ns = ecu.board.flash.bank.pack() if path.exists() else b"", clock_ns()
    until_ns = ecu.board.counter.now_ns
    while not is_stopped():
        now_ns = clock_ns()
        # `until_ns` advances only with the wall clock; flash operations advance only the board's own counter.
        until_ns, before_ns = until_ns + min(now_ns - before_ns, LONGEST_UNSEEN_NS), now_ns
        frames = [replace(frame, timestamp_ns=ecu.board.counter.now_ns) for frame in bus.receive_all()]
        for frame in ecu.advance(until_ns, frames):
            bus.send(frame)
        if (packed := ecu.board.flash.bank.pack()) != kept:
            kept = packed
            with replacing(path) as temporary:
                temporary.write_bytes(packed)
        wait()
