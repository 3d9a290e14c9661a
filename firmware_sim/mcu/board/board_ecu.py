"""The whole firmware on the emulated board as an ECU: it receives and sends frames through the board's CAN controller.
The class has the interface of `ecu.ecu.Ecu` for a closed loop, and `advance` for diagnosis. The firmware itself decides
when it makes a step: immediately if the step's frames include pressures, otherwise at the deadline in its compare
register. The board's time is then advanced to this deadline. Values for observers are read from the firmware's memory.
"""

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, Unpack

from can_bridge.bus.interface import HEALTHY, Bus, BusHealth
from can_bridge.wire.frame import Frame
from contract.atomic import replacing
from contract.errors import McuError
from ecu.ecu_state import Surroundings
from ecu.in_c.c_ecu import CEcuState, bundle_hash_of
from ecu.in_c.c_structs import Structs, c_time
from ecu.in_c.compiler import zig_compiler
from firmware_sim.mcu.board.board import BACKUP, BACKUP_BYTES, SRAM, SRAM_BYTES, Board
from firmware_sim.mcu.board.flash_controller import STM32H743, FlashBank, FlashTimes
from firmware_sim.mcu.board.small_parts import SystemReset
from firmware_sim.mcu.build import BUS_KEY, NO_COMPILER, Firmware, bus_key_header, compile_board, read_elf

_SCRATCH: Final = SRAM + SRAM_BYTES - 16384  # after all linked sections; for structs given to the firmware's functions
LONGEST_UNSEEN_NS: Final = 20_000_000
"""Longest advance in ns between two reads of the bus. If its emulation takes longer, the board's time falls behind."""


class BoardEcu(CEcuState):
    """A board that has just been powered on. `sources` is the result of `ecu.in_c.c_ecu.ecu_sources`; `own` files
    replace the board's files (`compile_board`), and `firmware` was compiled earlier from these sources. `Board`
    explains `bank` and `now_ns`. `secret` is the key of the bus, as written into a board at production; None without
    `bus.key`. `board` is the board of the present power cycle. `instructions` and `cycles` count those of the latest
    step, which waited for pressures for `waited_ns`; `resets` counts the resets that the firmware requested. Raises
    LibraryError if the library has no ECU; McuError if it does not compile, or the compiler is missing."""

    def __init__(
        self,
        sources: Mapping[str, bytes],
        *,
        clock_mhz: float = 480.0,
        bank: FlashBank | None = None,
        own: Mapping[str, bytes] | None = None,
        firmware: Firmware | None = None,
        times: FlashTimes = STM32H743,
        now_ns: int = 0,
        secret: bytes | None = None,
    ) -> None:
        compiler = zig_compiler()
        if compiler is None:
            raise McuError(NO_COMPILER)
        structs = Structs(sources, compiler)
        buffer, ecu = structs.ffi.buffer, structs.ffi.new("sw_ecu *")
        super().__init__(structs, ecu, bundle_hash_of(sources),
            lambda packed: self._asked("sw_ecu_calibrate", packed),
            lambda state: self._asked("sw_ecu_restore", buffer(state)),
        )  # fmt: skip
        self._clock_mhz, self._times = clock_mhz, times
        if secret is not None:
            own = {**(own or {}), BUS_KEY: bus_key_header(secret)}
        self.firmware = firmware or read_elf(compile_board(sources, own))
        self.resets = self.waited_ns = self.instructions = self.cycles = 0
        self._left = list[Frame]()
        self.description = f"emulated board, Cortex-M7 at {clock_mhz:g} MHz"
        self.power_on(bank or FlashBank(), now_ns)

    def power_on(self, bank: FlashBank, now_ns: int, *, cut_at: int = 0) -> None:
        """Start a new power cycle. The battery-supplied SRAM keeps its contents."""
        before: Board | None = getattr(self, "board", None)
        backup = b"" if before is None else before.peek(BACKUP, BACKUP_BYTES)
        self.board = Board(
            self.firmware, bank, now_ns=now_ns, times=self._times, cut_at=cut_at, seed=self.resets, backup=backup
        )
        self._run()
        self._place = self._pointer("sw_board_ecu")
        self._load()

    @property
    def step_ns(self) -> int:
        """Duration of the latest step in ns: the wait for pressures plus the core's modelled cycles."""
        return self.waited_ns + round(self.cycles * 1e3 / self._clock_mhz)

    def step(
        self, now_ns: int, frames: Sequence[Frame], health: BusHealth = HEALTHY, **around: Unpack[Surroundings]
    ) -> list[Frame]:
        """Run one control period like `Ecu.step`; `around` must be empty. Raises McuError if the core stopped."""
        if any(around.values()):
            raise McuError("a board's own firmware detects faults and updates: they cannot be passed to its step")
        self.board.blocks.start()
        self.board.counter.now_ns = max(c_time(now_ns), self.board.counter.now_ns)
        self.board.can.surround(health)
        steps = self._steps
        self._bring(frames)
        while self._steps == steps:
            self.board.counter.now_ns = max(self.board.counter.compare_ns, self.board.counter.now_ns)
            self._run()
        self.waited_ns = max(self.board.counter.now_ns - now_ns, 0)
        self.instructions, self.cycles = self.board.blocks.total()
        self._load()
        # The loop's bus models the transmission, so the board's frames are passed to this bus without delay.
        left, self._left = self._left, []
        return left + self.board.can.handed_over()

    def advance(self, until_ns: int, frames: Sequence[Frame] = ()) -> list[Frame]:
        """Receive frames, advance to `until_ns` and return the frames sent. Raises the errors of `Board.run`."""
        self._bring(frames)
        while self.board.counter.compare_ns <= until_ns:
            self.board.counter.now_ns = max(self.board.counter.compare_ns, self.board.counter.now_ns)
            self._run()
        self.board.counter.now_ns = max(until_ns, self.board.counter.now_ns)
        left, self._left = self._left, []
        return left + self.board.can.taken(self.board.counter.now_ns)

    def _bring(self, frames: Sequence[Frame]) -> None:
        """Pass the frames to the CAN controller in groups that fit its FIFO; the firmware runs after each group."""
        waiting = list(frames)
        while True:
            board = self.board
            here, waiting = waiting[: board.can.room], waiting[board.can.room :]
            for frame in here:
                board.can.receive(replace(frame, timestamp_ns=min(frame.timestamp_ns, board.counter.now_ns)))
            self._run()
            if not waiting:
                return

    def _run(self) -> None:
        board = self.board
        try:
            board.run()
        except SystemReset:
            self.resets += 1
            self._left += board.can.taken(board.counter.now_ns)
            board.flash.reset()
            self.power_on(board.flash.bank, board.counter.now_ns)

    @property
    def _steps(self) -> int:
        return self._pointer("sw_board_steps") + (self.resets << 32)

    def _pointer(self, symbol: str) -> int:
        (value,) = struct.unpack("<I", self.board.peek(self.board.symbol(symbol), 4))
        return int(value)

    def _asked(self, function: str, packed: Any) -> int:
        """Call a function of the ECU with a struct; then update the copy of the ECU's state and return the result."""
        self.board.poke(_SCRATCH, bytes(packed))
        answer = self.board.call(function, self._place, _SCRATCH)
        self._load()
        return answer

    def _load(self) -> None:
        """Copy the ECU's state, without its workspace, from the board's memory."""
        size = self.structs.size("sw_ecu")
        self.structs.ffi.buffer(self._ecu, size)[:] = self.board.peek(self._place, size)


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
        # `until_ns` follows the wall clock only; flash operations also advance the board's own counter.
        until_ns, before_ns = until_ns + min(now_ns - before_ns, LONGEST_UNSEEN_NS), now_ns
        frames = [replace(frame, timestamp_ns=ecu.board.counter.now_ns) for frame in bus.receive_all()]
        for frame in ecu.advance(until_ns, frames):
            bus.send(frame)
        if (packed := ecu.board.flash.bank.pack()) != kept:
            kept = packed
            with replacing(path) as temporary:
                temporary.write_bytes(packed)
        wait()
