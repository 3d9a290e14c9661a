"""From a model directory to a release bundle and, on request, a C library: read, round, lower, gate, write.

Every lowering has passed its gates before the first file is written.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from datetime import date
from pathlib import Path
from typing import Any, Final

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract import model_folder
from contract.arrays import Array
from contract.config.tree import Config
from contract.controller import c_folder as c_folder_format
from contract.errors import ExportError
from contract.recording import dataset
from contract.recording.dataset import Episode
from contract.release import bundle
from contract.release.manifest import PRECISIONS
from export.int8.calibrate import rounded_on
from export.program.controller_program import ControllerProgram
from export.program.from_training import program_of
from export.program.recorded_windows import recorded_windows
from export.release.bundle import Vehicle, write_release
from export.release.c_folder import write_c_release
from export.release.gated import Gated, gate
from export.release.lowering import lower

GATE_WINDOWS: Final = 50
"""Consecutive recorded windows that the export gates replay."""
CALIBRATION_WINDOWS: Final = 400
"""Recorded windows from which int8 rounding is calibrated, of every kind of forcing together."""


PHASES: Final = ("read", "round weights", "lower and gate", "write")
"""Of an export, in order."""


def gate_figures(gated: Gated) -> Iterator[tuple[str, Any]]:
    """Every figure of every gate by its name."""
    parts = {
        "graph against reference": gated.graph.parity,
        "int8 against float32": gated.graph.quantisation,
        "C against reference": gated.library and gated.library.parity,
        "int8 C against float32": gated.library and gated.library.quantisation,
    }
    for title, part in parts.items():
        for name, value in asdict(part).items() if part else ():
            yield f"{title}: {name}", value


def calibration_windows(program: ControllerProgram, episodes: Sequence[Episode]) -> list[Array]:
    """Windows (L, S+1) of the last episode of every kind of forcing: what a controller meets differs between them.

    Raises:
        ExportError: an episode is too short.
    """
    last = {item.provenance.get("forcing_signal"): item for item in episodes}.values()
    return [window for item in last for window in recorded_windows(program, item, CALIBRATION_WINDOWS)[:: len(last)]]


def export_all(
    model: Path,
    output: Path,
    *,
    precision: str,
    name: str,
    recording: Path,
    config: Config,
    c_folder: Path | None,
    created: date,
    key: Ed25519PrivateKey | None = None,
    phase: Callable[[str], None] = lambda name: None,
) -> Gated:
    """Write the C library, if a folder is given for it, and then the bundle; neither unless both pass their gates.

    Args:
        model: directory written by `train`.
        precision: "int8" or "float32", of both.
        recording: data set whose test episode the gates replay, and whose training episodes calibrate int8.
        created: today.
        key: to sign the bundle with; unsigned if None.
        phase: called with each of `PHASES` when it begins.

    Raises:
        ModelError: the model directory is not sound.
        ExportError: its weights do not fit, or a lowering does not pass its gates.
        LibraryError: there is no C compiler for a library that is asked for.
        StillwakeError: a file cannot be read or written.
    """
    if precision not in PRECISIONS:
        raise ExportError(f"--precision {precision}: must be int8 or float32")
    # Before the work: neither place is written if the other one cannot be.
    bundle.check_replaceable(output)
    if c_folder is not None:
        c_folder_format.check_replaceable(c_folder)
    phase("read")
    trained = model_folder.read(model)
    program = program_of(trained, config.mpc)
    episodes = dataset.read(recording)
    windows = recorded_windows(program, episodes.with_role("test")[0], GATE_WINDOWS)
    calibration = calibration_windows(program, episodes.with_role("train"))

    phase("round weights")
    rounded = rounded_on(program, calibration) if precision == "int8" else program
    phase("lower and gate")
    gated = gate(lower(rounded, calibration=calibration, with_library=c_folder is not None), windows)

    phase("write")
    if c_folder is not None:
        write_c_release(c_folder, gated, windows)
    write_release(
        output,
        gated,
        name=name,
        created=created,
        vehicle=Vehicle.of(config),
        provenance=trained.provenance,
        key=key,
    )
    return gated
