"""What the whole ECU needs as a board's firmware, in control: memory, and the work of its longest step."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Mode
from contract.errors import McuError
from firmware_sim.mcu.board.board_ecu import BoardEcu
from firmware_sim.mcu.cores import CORTEX_M7
from firmware_sim.mcu.measure import flash_bytes, linked_ram

Periods = Iterable[tuple[int, Sequence[Frame]]]
"""(time in ns, frames received) of control periods."""


@dataclass(frozen=True, kw_only=True)
class EcuMeasurement:
    """What a step of the ECU needs.

    Attributes:
        flash_bytes, ram_bytes, stack_bytes: memory; RAM is what is linked there and the deepest stack.
        instructions, cycles: of the longest step; cycles are modelled (`firmware_sim.mcu.pipeline`).
        instruction_spread: instructions of the longest step in control less those of the shortest.
        modelled_ms: of the longest step, by clock in MHz.
        steps, in_control: measured ones, and how many of them planned.
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
    """Step the ECU of a library as a board's firmware. Raises LibraryError if the library has no ECU; McuError if it
    does not compile or run, or it never came into control.

    Args:
        sources: the library's files by name, `sw_ecu_settings.h` among them.
        periods: enough of them that the window fills and the ECU comes into control.
        iterates: calibrated with a weight that no prior knows, so that all iterations run; or with the release's own.
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
