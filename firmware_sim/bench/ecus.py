"""The ECU in C for a run: compiled for this machine, or as the firmware of an emulated microcontroller."""

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
"""Kind of an ECU whose whole firmware runs on an emulated board with a Cortex-M7."""


def check_ecu(kind: str, clock_mhz: float) -> None:
    """Check that an ECU of this kind can be created. For C, raises LibraryError if there is no compiler. For
    MCU, raises ConfigError for an impossible clock, and ModuleNotFoundError if the extra mcu is not installed."""
    if kind == C:
        host_compiler()
        return
    # At lower rates a control step takes seconds; no core has a higher rate.
    if not 1.0 <= clock_mhz <= 10_000.0:
        raise ConfigError(f"a clock of {clock_mhz:g} MHz is not possible: it must be in 1..10000 MHz")
    import_module("firmware_sim.mcu.board.board_ecu")


def loop_ecu(
    kind: str, sources: Mapping[str, bytes], *, clock_mhz: float = 480.0, secret: bytes | None = None
) -> LoopEcu:
    """Return a newly powered-on ECU in C: compiled for this machine (kind C) or on the emulated board (kind MCU).
    `sources` is the result of `ecu.in_c.c_ecu.ecu_sources`; `secret` is the key of the bus, or None without `bus.key`.
    Raises the errors of `check_ecu`; LibraryError if the sources contain no ECU; McuError if they do not compile."""
    precision = ProgramSettings.of(sources).text("SW_PRECISION")
    if kind == C:
        host = CEcu(sources, secret=secret)
        return LoopEcu(ecu=host, kind=kind, computed_by=f"C99 {precision}, {host.description}")
    check_ecu(kind, clock_mhz)
    # This import is inside the function, because the emulator is an optional dependency (extra mcu).
    from firmware_sim.mcu.board.board_ecu import BoardEcu

    core = BoardEcu(sources, clock_mhz=clock_mhz, secret=secret)
    return LoopEcu(
        ecu=core,
        kind=MCU,
        computed_by=f"C99 {precision}, {core.description}",
        step_ns=lambda: core.step_ns,
        clock_mhz=clock_mhz,
        start_clock=lambda: core.power_on(core.board.flash.bank, 0),
    )
