"""The parts of the ECU in C that decide, and vehicles to compile them for: the usual one, and two with other limits."""

from dataclasses import replace
from typing import Final

from contract.config.tree import Config
from contract.config.vehicle import EcuConfig

SOURCES: Final = ("sw_timing.c", "sw_fail_safe.c", "sw_gate.c", "sw_memory.c")


def _vehicle(**changes: object) -> Config:
    ecu = replace(EcuConfig(), **changes)  # type: ignore[arg-type]
    # The random release has no estimator.
    ecu = replace(ecu, sensor_check=replace(ecu.sensor_check, enabled=False))
    return replace(Config(), ecu=ecu)


VEHICLES: Final = {
    "usual": _vehicle(),
    # Nothing is borne, and nothing settled when the ECU plans; the windows are all that C has room for.
    "strict": _vehicle(
        hold_periods=0,
        decay_periods=0,
        rearm_frames=1,
        loss_window=64,
        loss_limit=2,
        deadline_window=32,
        deadline_misses=1,
        plan_ahead=False,
        command_step=0.01,
        pressure_age=1.0,
    ),
    "lenient": _vehicle(
        hold_periods=2,
        decay_periods=3,
        rearm_frames=3,
        loss_window=1,
        loss_limit=1,
        deadline_window=1,
        deadline_misses=2,
        delay_steps=2,
    ),
}
