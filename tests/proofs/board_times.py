"""What diagnosis takes from control on a board: the longest period under a flood of requests, and its own pieces.

The shipped release as machine code on the emulated board, its cycles modelled. Control waits for one running piece of
diagnosis at most, so both together have to fit into the period. The memory's own times are not in it.
"""

from hashlib import sha256
from typing import Any, Final

from benchmarks.controller.worst_period import Vehicle
from can_bridge.isotp import control_info
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Mode
from contract.config.loading import load_config
from contract.controller.c_folder import ProgramRows, read_recorded
from contract.errors import StillwakeError
from contract.release import bundle
from contract.shipped import BUNDLE
from firmware_sim.mcu.board.board import SRAM, SRAM_BYTES
from firmware_sim.mcu.board.flash_controller import FlashBank
from firmware_sim.mcu.build import CORTEX_M7
from stillwake.parts.c_release import library_folder
from tests.can_bridge.flashing.releases import keys
from tests.can_bridge.uds.addresses import REQUEST_ID
from tests.ecu.in_c.exported import Exported
from tests.firmware_sim.mcu.board_node import BoardLine, Built
from tests.proofs.command_line import JsonFile, report

CONFIG: Final = load_config()
PERIODS: Final = 120
FLOODS: Final = (0, 10, 60)  # requests in a period
BLOCK: Final = 4078  # bytes of a TransferData in a message of 4 KiB
WORKING: Final = 1  # `SW_STORE_WORKING`: there is another piece to come
RECORDS: Final = 3 * 4  # bytes of `sw_store` before its records: three pointers
SCRATCH: Final = SRAM + SRAM_BYTES - 8192
_HEX: Final = f"22FD03 22{16 * 'F186'} 22FD01 22FD11 190A 1902FF 3E00 1003 2703 2704{32 * '0'}"
REQUESTS: Final = tuple(map(bytes.fromhex, _HEX.split()))
"""Identifiers, faults, sessions, a seed and a wrong key."""


def main(json_file: JsonFile = None) -> None:
    """Measure the pieces of the loader's work on the emulated board. A step in a flood of requests, and a step with a
    piece of this work, which needs shut jets, must be shorter than a period."""
    with library_folder(None) as folder:
        release = bundle.load(BUNDLE)
        built = Built(Exported(bundle=release, bundle_path=BUNDLE, folder=folder), CONFIG)
        rows = read_recorded(folder)
        board = built.ecu()
        BoardLine(board).provision(keys(), built.image("one"))
        bank = board.board.flash.bank.pack()
        pieces = _pieces(board, built.image("two", 2))
        floods = {count: _longest(built, board.firmware, FlashBank.unpack(bank), rows, count) for count in FLOODS}
        shut = _longest(built, board.firmware, FlashBank.unpack(bank), rows, FLOODS[-1], asks=False)
    cycles_of = {f"{count} requests in a period": cycles for count, cycles in floods.items()}
    cycles_of |= {f"{FLOODS[-1]} requests, the jets shut": shut} | pieces
    clocks = CORTEX_M7.clocks_mhz
    figures = {of: {f"{mhz} MHz": round(n / (mhz * 1e3), 2) for mhz in clocks} for of, n in cycles_of.items()}
    packages = ("stillwake", "unicorn", "ziglang")
    report(json_file, "diagnosis beside control", figures, packages=packages, bundle=release.manifest.name,
           digest=release.digest, period_ms=CONFIG.period_ns / 1e6)  # fmt: skip
    longest = max(*floods.values(), shut + max(pieces.values()))
    if longest > clocks[-1] * 1e-3 * CONFIG.period_ns:
        raise StillwakeError(f"a period and what diagnosis does in it take {longest} cycles together")


def _longest(built: Built, firmware: Any, bank: FlashBank, rows: ProgramRows, flood: int, *, asks: bool = True) -> int:
    """Cycles of the longest period with so many requests in each, the last of them under control if that is asked."""
    board, vehicle, cycles, planned = built.ecu(bank, firmware), Vehicle(CONFIG, rows, asks=asks), list[int](), 0
    for number in range(PERIODS):
        requests = (control_info.single(REQUESTS[(number + k) % len(REQUESTS)]) for k in range(flood))
        asked = [Frame(frame_id=REQUEST_ID, data=request, is_fd=True) for request in requests]
        board.step(vehicle.now_ns, [*asked, *vehicle.frames()])
        cycles.append(board.cycles)
        planned += board.trace.mode is Mode.CONTROL
    if (planned > 0) != asks:
        raise StillwakeError(f"with {flood} requests in a period the board is in control for {planned} of {PERIODS}")
    return max(cycles)


def _pieces(board: Any, image: bytes) -> dict[str, int]:
    """Cycles of what the store does in one call, the longest of each kind."""
    store, core = board._pointer("sw_board_store"), board.board

    def call(name: str, data: bytes = b"", *more: int) -> tuple[int, int]:
        core.poke(SCRATCH, data)
        core.blocks.start()
        answer = core.call(name, store, *more)
        return int(answer), core.blocks.total()[1]

    def go_on(answer: int) -> list[int]:
        cycles = []
        while answer == WORKING:
            # An erasure is looked after every millisecond.
            core.counter.now_ns += 1_000_000
            answer, one = call("sw_store_go_on")
            cycles.append(one)
        return cycles

    def taken(block: bytes) -> list[int]:
        answer, first = call("sw_store_append", block, SCRATCH, len(block))
        return [first, *go_on(answer)]

    core.blocks.start()
    core.call("sw_records_care", store + RECORDS)
    looked = core.blocks.total()[1]
    _, listed = call("sw_store_take_keys", keys(2), SCRATCH, len(keys(2)))
    answer, announced = call("sw_store_announce", sha256(image).digest(), len(image), SCRATCH)
    cleared = go_on(answer)
    blocks = [image[start : start + BLOCK] for start in range(0, len(image), BLOCK)]
    written = [cycles for block in blocks for cycles in taken(block)]
    answer, begun = call("sw_store_finish")
    *checked, ended = go_on(answer)
    return {
        "a sector of records found blank": looked,
        "a key list's signature": listed,
        "an announcement": announced,
        "a look at a sector that is cleared": max(cleared),
        "a piece of a block of 4 KiB, 512 bytes": max(written),
        "the beginning of a check": begun,
        "a piece of a check, 4 KiB hashed twice": max(checked),
        "the end of a check, with its signature": ended,
    }
