"""The whole firmware on the emulated board as an ECU of a closed loop: frames in and out through its CAN controller.

It has the interface of `firmware_sim.ecu.ecu.Ecu`. When a step takes place is the firmware's own decision: on the
pressures of the step's frames, or, where there are none, at the deadline in its compare register, to which time then
passes. What an observer sees of its state is read from its memory, as by a debugger.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from can_bridge.bus.interface import HEALTHY, BusHealth
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Reason
from contract.errors import McuError
from firmware_sim.in_c.c_ecu import CEcuState, bundle_hash_of
from firmware_sim.in_c.c_structs import Structs, c_time
from firmware_sim.in_c.compiler import zig_compiler
from firmware_sim.mcu.board.board import SRAM, SRAM_BYTES, Board
from firmware_sim.mcu.board.flash_controller import FlashBank
from firmware_sim.mcu.build import MISSING, compile_board
from firmware_sim.mcu.elf import read_elf

_SCRATCH: Final = SRAM + SRAM_BYTES - 64
"""Of the debugger, behind everything that is linked."""


class BoardEcu(CEcuState):
    """A board just powered on.

    Args:
        sources: of a C library with its ECU, and of the board's firmware.
        clock_mhz: of the core.
        bank: the flash that is written in the field; erased if None.

    Attributes:
        board: the board itself.
        description: what computes the step, for people.
        instructions, cycles: of the latest step; the cycles are modelled.
        waited_ns: how long the latest step waited for pressures.

    Raises:
        LibraryError: the library has no ECU.
        McuError: it does not compile, or the compiler is missing.
    """

    def __init__(
        self, sources: Mapping[str, bytes], *, clock_mhz: float = 480.0, bank: FlashBank | None = None, now_ns: int = 0
    ) -> None:
        compiler = zig_compiler()
        if compiler is None:
            raise McuError(MISSING)
        structs = Structs(sources, compiler)
        ecu = structs.ffi.new("sw_ecu *")
        super().__init__(structs, ecu, bundle_hash_of(sources), self._calibrated, self._restored)
        self._clock_mhz = clock_mhz
        self.firmware = read_elf(compile_board(sources))
        self.board = Board(self.firmware, bank, now_ns=now_ns)
        self.instructions, self.cycles = self.board.run()
        self.waited_ns = 0
        (self._place,) = struct.unpack("<I", self.board.peek(self.board.symbol("sw_board_ecu"), 4))
        self.description = f"whole firmware on an emulated board, Cortex-M7 at {clock_mhz:g} MHz"
        self._load()

    @property
    def step_ns(self) -> int:
        """What the board takes for the latest step: a wait for pressures, and the core's cycles by the model."""
        return self.waited_ns + round(self.cycles * 1e3 / self._clock_mhz)

    def step(
        self,
        now_ns: int,
        frames: Sequence[Frame],
        health: BusHealth = HEALTHY,
        *,
        fault: Reason | None = None,
        updating: bool = False,
    ) -> list[Frame]:
        """One control period; as `Ecu.step`, but for `fault` and `updating`, which the firmware finds by itself.

        Raises:
            McuError: the core stopped.
        """
        if fault is not None or updating:
            raise McuError("a fault or an update from outside: the board's firmware finds them by itself")
        board = self.board
        board.counter.now_ns, self.waited_ns = c_time(now_ns), 0
        deadline_ns = board.counter.compare_ns
        board.can.surround(health)
        self.instructions = self.cycles = 0
        waiting = list(frames)
        while True:
            # As many as its FIFO takes; on a real bus the core, which sleeps, is quicker than frames come.
            here, waiting = waiting[: board.can.room], waiting[board.can.room :]
            for frame in here:
                board.can.receive(replace(frame, timestamp_ns=min(frame.timestamp_ns, board.counter.now_ns)))
            self._run()
            if not waiting:
                break
        if board.counter.compare_ns == deadline_ns:
            self.waited_ns = deadline_ns - board.counter.now_ns
            board.counter.now_ns = deadline_ns
            self._run()
        self._load()
        sent, board.can.sent = board.can.sent, []
        return sent

    def _run(self) -> None:
        instructions, cycles = self.board.run()
        self.instructions += instructions
        self.cycles += cycles

    def _calibrated(self, packed: bytes) -> int:
        """What `sw_ecu_calibrate` answers to an `sw_calibration`."""
        self.board.poke(_SCRATCH, packed)
        answer = self.board.call("sw_ecu_calibrate", self._place, _SCRATCH)
        self._load()
        return answer

    def _restored(self, place: Any) -> int:
        """Into the board's memory; only the delay is judged."""
        if place.memory.frozen != self._ecu.state.memory.frozen:
            return 1
        self._ecu.state = place[0]
        self._ecu.trace.planned = self._ecu.trace.interventions = 0
        self._ecu.trace.action = place.memory.under_way[place.memory.frozen]
        self.board.poke(self._place, bytes(self.structs.ffi.buffer(self._ecu, self._mirrored)))
        return 0

    def _load(self) -> None:
        """The ECU in the board's memory, but for its workspace, into the mirror of it."""
        self.structs.ffi.buffer(self._ecu, self._mirrored)[:] = self.board.peek(self._place, self._mirrored)

    @property
    def _mirrored(self) -> int:
        return self.structs.size("sw_ecu")
