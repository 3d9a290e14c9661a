"""The needs of the whole ECU as a board's firmware under control: memory, and the work of its longest step."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Mode
from contract.errors import McuError
from firmware_sim.mcu.board.board_ecu import BoardEcu
from firmware_sim.mcu.cores import CORTEX_M7
from firmware_sim.mcu.measure import flash_bytes, linked_ram

Periods = Iterable[tuple[int, Sequence[Frame]]]
"""Control periods as pairs (time in ns, frames received)."""


@dataclass(frozen=True, kw_only=True)
class EcuMeasurement:
    """The needs of a step of the ECU.

    Attributes:
        flash_bytes, ram_bytes, stack_bytes: memory; RAM is the linked RAM plus the deepest stack.
        instructions, cycles: largest numbers in a step; cycles are modelled (`firmware_sim.mcu.pipeline`).
        instruction_spread: difference between the most and the fewest instructions of a step under control.
        modelled_ms: time of the longest step, by clock in MHz.
        steps, in_control: number of measured steps, and of those with a plan.
    """

    flash_bytes: int
    ram_bytes: int
    stack_bytes: int
    instructions: int
    cycles: int
    instruction_spread: int
    modelled_ms: dict[str, float]
    steps: int
    in_control: int


def measure_ecu(sources: Mapping[str, bytes], periods: Periods, *, iterates: bool = True) -> EcuMeasurement:
    """Run the ECU of a library as a board's firmware and measure its steps. Raises LibraryError if the library has no
    ECU; McuError if it does not compile or run, or never comes into control.

    Args:
        sources: files of the library by name, among them `sw_ecu_settings.h`.
        periods: enough control periods for the window to fill and the ECU to come into control.
        iterates: True to set a weight that no prior was trained for, so that all iterations run; False for the
            release's own weights.
    """
    ecu = BoardEcu(sources)
    own = ecu.calibration
    ecu.calibrate(replace(own, weights=replace(own.weights, rate=own.weights.rate + 1e-6 * iterates)))
    instructions, cycles, planned = [], [], list[int]()
    for now_ns, frames in periods:
        ecu.step(now_ns, frames)
        instructions.append(ecu.instructions)
        cycles.append(ecu.cycles)
        if ecu.trace.mode is Mode.CONTROL:
            planned.append(ecu.instructions)
    if not planned:
        raise McuError(f"the ECU did not come into control in {len(instructions)} control periods")
    longest, stack = max(cycles), ecu.board.stack_depth()
    return EcuMeasurement(
        flash_bytes=flash_bytes(ecu.firmware),
        ram_bytes=linked_ram(ecu.firmware) + stack,
        stack_bytes=stack,
        instructions=max(instructions),
        cycles=longest,
        instruction_spread=max(planned) - min(planned),
        modelled_ms={str(clock): longest / (clock * 1e3) for clock in CORTEX_M7.clocks_mhz},
        steps=len(instructions),
        in_control=len(planned),
    )
