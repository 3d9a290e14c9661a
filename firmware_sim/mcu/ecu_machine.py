"""The ECU in C on an emulated Cortex-M7: frames are written into its memory, it steps, and frames are read out.

It has the interface of `firmware_sim.ecu.ecu.Ecu`, and reports for each step how long the core would have taken, by the
model of its pipeline (`firmware_sim.mcu.pipeline`) and the basic blocks that this very step executed.
"""

import struct
from collections.abc import Mapping, Sequence
from typing import Any, Final, Unpack

from can_bridge.bus.interface import HEALTHY, BusHealth
from can_bridge.wire.frame import Frame
from contract.errors import McuError
from firmware_sim.ecu.ecu_state import Around
from firmware_sim.in_c.c_ecu import CEcuState, bundle_hash_of
from firmware_sim.in_c.c_structs import Structs, c_time
from firmware_sim.in_c.compiler import zig_compiler
from firmware_sim.mcu.build import ECU, MISSING, compile_for_cortex_m7
from firmware_sim.mcu.elf import read_elf
from firmware_sim.mcu.emulator import MESSAGES, MESSAGES_BYTES, Machine

CLOCK_MHZ: Final = 480


class McuEcu(CEcuState):
    """A C library's ECU on an emulated core, just powered on. Raises LibraryError if the library has no ECU; McuError
    if it does not compile, or the compiler is missing.

    Args:
        sources: the library's files by name, `sw_ecu_settings.h` among them.
        clock_mhz: of the core.

    Attributes:
        description: what computes the step, for people.
        instructions, cycles: of the latest step; the cycles are modelled.
    """

    def __init__(self, sources: Mapping[str, bytes], *, clock_mhz: float = CLOCK_MHZ) -> None:
        compiler = zig_compiler()
        if compiler is None:
            raise McuError(MISSING)
        structs = Structs(sources, compiler)
        ecu = structs.ffi.new("sw_ecu *")
        super().__init__(structs, ecu, bundle_hash_of(sources), self._calibrated, self._restored)
        self._clock_mhz = clock_mhz
        self._frame_bytes = structs.size("sw_frame")
        self._machine = Machine(read_elf(compile_for_cortex_m7(sources, main=ECU)))
        self._counter = self._machine.block_counter()
        self._machine.call("mcu_reset")
        self._load()
        self.instructions = self.cycles = 0
        self.description = f"emulated Cortex-M7 at {clock_mhz:g} MHz"
        self.restore(self.saved())

    @property
    def step_ns(self) -> int:
        """What the core takes for the latest step, by the model."""
        return round(self.cycles * 1e3 / self._clock_mhz)

    def paint_stack(self) -> None:
        """Mark the core's stack as untouched."""
        self._machine.paint_stack()

    def stack_depth(self) -> int:
        """Bytes of the core's stack that were touched since then."""
        return self._machine.stack_depth()

    def step(
        self, now_ns: int, frames: Sequence[Frame], health: BusHealth = HEALTHY, **around: Unpack[Around]
    ) -> list[Frame]:
        """One control period; as `Ecu.step`. Raises McuError if the core stopped, or more frames came than its CAN
        controller has room for."""
        machine, ffi = self._machine, self.structs.ffi
        if len(frames) * self._frame_bytes > MESSAGES_BYTES:
            room = MESSAGES_BYTES // self._frame_bytes
            raise McuError(f"{len(frames)} frames in one control period: the core's CAN controller keeps {room}")
        self.structs.surround(self._ecu.surroundings, health, **around)
        self._store()
        machine.write_at(MESSAGES, bytes(ffi.buffer(self.structs.frames(frames))))
        machine.write("mcu_now_ns", struct.pack("<q", c_time(now_ns)))
        machine.write("mcu_frames_in", struct.pack("<I", MESSAGES))
        machine.write("mcu_count", struct.pack("<i", len(frames)))
        self._counter.start()
        count = machine.call("mcu_ecu_step")
        self.instructions, self.cycles = self._counter.total()
        self._load()
        if count > 0:
            answers = ffi.from_buffer("sw_frame[]", machine.read("mcu_frames_out", count * self._frame_bytes))
        return [self.structs.frame(answers[i]) for i in range(count)]

    def _calibrated(self, packed: bytes) -> int:
        """What the core answers to an `sw_calibration`."""
        self._store()
        self._machine.write("mcu_calibration", packed)
        answer = self._machine.call("mcu_ecu_calibrate")
        self._load()
        return answer

    def _restored(self, place: Any) -> int:
        """In the mirror, which the next step writes back; only the delay is judged."""
        if place.memory.frozen != self._ecu.state.memory.frozen:
            return 1
        self._ecu.state = place[0]
        self._ecu.trace.planned = self._ecu.trace.interventions = 0
        self._ecu.trace.action = place.memory.under_way[place.memory.frozen]
        return 0

    def _load(self) -> None:
        """The core's memory, but for the workspace, into the mirror of it."""
        place = self.structs.ffi.buffer(self._ecu, self._mirrored)
        place[:] = self._machine.read("mcu_ecu", self._mirrored)

    def _store(self) -> None:
        self._machine.write("mcu_ecu", bytes(self.structs.ffi.buffer(self._ecu, self._mirrored)))

    @property
    def _mirrored(self) -> int:
        return self.structs.size("sw_ecu")
