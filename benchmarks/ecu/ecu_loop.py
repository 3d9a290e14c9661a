"""The closed loop with each ECU: in Python, in C on this machine, and in C on an emulated Cortex-M7.

    python -m benchmarks ecu-loop [--json FILE]

Each ECU controls the live wake from the same initial state over the same bus. In the loop with the emulated core, a
second ECU on this machine receives the same frames at the same times. It has the same sources and compiler, and fuses
the same floating-point operations. After every step, all frames and the whole states of both ECUs are compared bit for
bit. The virtual compute time is the core's modelled time in this loop, and `ecu.compute_time_ms` in the other loops.
Finished loops are stored in a folder named after the hash of their inputs.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final, Unpack

import numpy as np
import typer

from benchmarks.common.command_line import JsonFile, Parts, bars, console, part, report
from benchmarks.ecu import tables
from can_bridge.bus.interface import HEALTHY, BusHealth
from can_bridge.wire.frame import Frame
from contract.config.loading import load_config
from contract.controller.calibration import Calibration
from contract.errors import McuError, install
from contract.results import versions
from ecu.ecu_state import EcuState, Surroundings
from ecu.in_c.c_ecu import CEcu, ecu_sources
from ecu.in_c.compiler import zig_compiler
from ecu.stepped import CalibratedEcu
from firmware_sim.bench.ecus import MCU, C, loop_ecu
from firmware_sim.bench.simulation import Simulation, Spans
from firmware_sim.mcu.build import COMMON
from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.summary import summary
from stillwake.console.progress import progress
from stillwake.parts.c_release import library_folder
from stillwake.parts.releases import open_release
from wake.plants import own_wake

ECUS: Final = (MCU, C, "python")
COMPARED: Final = (*COMMON, "-march=native")
"""Compiler flags of the ECU that is compared with the emulated core. The compiler fuses the same floating-point
operations as for the core, so this machine must have fused multiply-add."""
_KEPT: Final = (
    *("Cd_uncontrolled", "Cd_controlled", "reduction_percent", "abs_Cl_uncontrolled", "abs_Cl_controlled"),
    *("mean_Cl_controlled", "rms_action", "periods_requested", "periods_in_control", "fault", "computed_by", "ecu"),
)


def main(
    json_file: JsonFile = None,
    parts: Parts = Path("runs/ecu_loop"),
    lead_in: Annotated[float, typer.Option(help="Time without control, t_c.")] = 25.0,
    controlled: Annotated[float, typer.Option(help="Time with control, t_c.")] = 100.0,
    settle: Annotated[float, typer.Option(help="Time left out of the controlled averages, t_c.")] = 40.0,
) -> None:
    """Run the three closed loops and print a table."""
    release = open_release(None)
    config = replace(load_config(), mpc=release.manifest.mpc)
    with library_folder(None) as folder:
        sources = ecu_sources(folder, release, config)
    spans = Spans(lead_in=lead_in, controlled=controlled, settle=settle, averages=True)
    compiler = zig_compiler()
    if compiler is None:
        raise McuError(f"ziglang is missing: {install('mcu')}")
    made_from = (release.digest, sorted(sources.items()), lead_in, controlled, settle)
    folder = parts / hashlib.sha256(repr(made_from).encode()).hexdigest()[:12]

    def driven_by(kind: str) -> dict[str, Any]:
        ecu = None if kind == "python" else loop_ecu(kind, sources)
        lockstep: Any = None
        if ecu is not None and kind == MCU:
            lockstep = Lockstep(ecu.ecu, CEcu(sources, compiler=compiler, flags=COMPARED))
            ecu = replace(ecu, ecu=lockstep)
        with progress("periods", console=bars) as shown:
            log = Simulation(release, config, spans=spans, ecu=ecu).run(
                own_wake(config),
                ready=lambda total: shown(f"ECU {kind}", 0, total),
                progress=lambda row, done, total: shown(f"ECU {kind}", done, total, f"Cd {row.sample.Cd:.3f}"),
            )
        # A skipped step is null in the results file, because JSON has no NaN.
        commands = [value if np.isfinite(value) else None for value in log.series["command"].tolist()]
        return {"row": figures_of(kind, log, lockstep), "commands": commands}

    found = {kind: part(folder / f"{kind}.json", partial(driven_by, kind)) for kind in ECUS}
    commands = {kind: np.array(one["commands"], dtype=np.float64) for kind, one in found.items()}
    rows = []
    for kind, one in found.items():
        # Steps that an ECU skipped are left out.
        largest = float(np.nanmax(np.abs(commands[kind] - commands[C]), initial=0.0))
        rows.append(one["row"] | {"largest_command_difference": largest})
    facts = {
        "bundle": release.digest,
        "spans": {"lead_in": lead_in, "controlled": controlled, "settle": settle},
        "period_ms": config.period_ns / 1e6,
        "compute_time_ms": config.ecu.compute_time_ms,
        "compared_with": " ".join(COMPARED),
        "versions": versions("stillwake", "onnxruntime", "numpy", "numba", "ziglang", "unicorn", "capstone"),
    }
    report(json_file, rows, facts, tables.loops)
    for line in rows[0]["differences"]:
        console.print(line)


class Lockstep:
    """A pair of ECUs with the interface of one ECU. Every call goes to `driver` and to `other`. The pair returns the
    driver's frames, and counts the compared steps and frames, the frames that differed in a byte or in time or that
    only one ECU sent, and the steps after which the states differed in a bit. `differences` has a line for each of the
    first differences. All other attributes belong to the driver."""

    def __init__(self, driver: Any, other: CalibratedEcu) -> None:
        self._driver, self._other = driver, other
        self.steps = self.frames = self.differing_frames = self.differing_states = 0
        self.differences: list[str] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._driver, name)

    def calibrate(self, calibration: Calibration) -> None:
        """Set this calibration in both ECUs."""
        for ecu in (self._driver, self._other):
            ecu.calibrate(calibration)

    def restore(self, state: EcuState) -> None:
        """Set this state in both ECUs."""
        for ecu in (self._driver, self._other):
            ecu.restore(state)

    def step(
        self, now_ns: int, frames: Sequence[Frame], health: BusHealth = HEALTHY, **around: Unpack[Surroundings]
    ) -> list[Frame]:
        """Step both ECUs for one control period; return the driver's frames."""
        sent, expected = (ecu.step(now_ns, frames, health, **around) for ecu in (self._driver, self._other))
        self.steps += 1
        self.frames += max(len(sent), len(expected))
        same = sum(one == other for one, other in zip(sent, expected, strict=False))
        differs = max(len(sent), len(expected)) - same
        fields = self._driver.differing(self._other.state)
        self.differing_frames += differs
        self.differing_states += bool(fields)
        if (differs or fields) and len(self.differences) < 10:
            state = ", ".join(fields) or "same"
            self.differences.append(f"step {self.steps} at {now_ns} ns: {differs} frames, state: {state}")
        return sent


def figures_of(kind: str, log: RunLog, lockstep: Lockstep | None) -> dict[str, Any]:
    """Return the figures of a run for storage, and the figures of the comparison if two ECUs were compared."""
    found = summary(log)
    row = {"kind": kind, **{name: found[name] for name in _KEPT}}
    if lockstep is None:
        return row
    names = ("steps_compared", "frames_compared", "differing_frames", "differing_states", "differences")
    return row | {name: getattr(lockstep, name.removesuffix("_compared")) for name in names}
