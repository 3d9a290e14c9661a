"""The ECU in C of a run, by its name: on this machine, or as the firmware of an emulated microcontroller."""

from collections.abc import Mapping
from importlib import import_module
from typing import Final

from contract.controller.c_folder import ProgramSettings
from contract.errors import ConfigError
from ecu.in_c.c_ecu import CEcu
from ecu.in_c.compiler import host_compiler
from ecu.stepped import LoopEcu

C: Final = "c"
MCU: Final = "mcu"
"""The whole firmware of a board with a Cortex-M7, emulated."""
CLOCKS_MHZ: Final = (1.0, 10_000.0)
"""Range of clocks; a core at less takes seconds for a step, and none runs at more."""


def check_ecu(kind: str, clock_mhz: float) -> None:
    """Check what can be checked before there are sources.

    Raises:
        ConfigError: no clock that a core could have.
        LibraryError: there is no compiler for C.
        ModuleNotFoundError: the emulator is not installed (extra mcu).
    """
    if kind == C:
        host_compiler()
        return
    lowest, highest = CLOCKS_MHZ
    if not lowest <= clock_mhz <= highest:
        raise ConfigError(f"a clock of {clock_mhz:g} MHz: must be in {lowest:g}..{highest:g}")
    import_module("firmware_sim.mcu.board.board_ecu")


def loop_ecu(
    kind: str, sources: Mapping[str, bytes], *, clock_mhz: float = 480.0, secret: bytes | None = None
) -> LoopEcu:
    """An ECU in C, just powered on.

    Args:
        kind: C or MCU.
        sources: `ecu.in_c.c_ecu.ecu_sources`.
        clock_mhz: of the emulated core.
        secret: the key, where the sources are of a bus with `bus.key`.

    Raises:
        ConfigError: no clock that a core could have.
        LibraryError: there is no compiler, or the sources are no ECU.
        McuError: they do not compile for the core.
    """
    precision = ProgramSettings.of(sources).text("SW_PRECISION")
    if kind == C:
        host = CEcu(sources, secret=secret)
        return LoopEcu(ecu=host, kind=kind, computed_by=f"C99 {precision}, {host.description}")
    check_ecu(kind, clock_mhz)
    # The emulator is of an extra.
    from firmware_sim.mcu.board.board_ecu import BoardEcu

    core = BoardEcu(sources, clock_mhz=clock_mhz, secret=secret)
    return LoopEcu(
        ecu=core,
        kind=MCU,
        computed_by=f"C99 {precision}, {core.description}",
        step_ns=lambda: core.step_ns,
        clock_mhz=clock_mhz,
    )
