"""From a model directory to a release bundle and, on request, a C library: read, calibrate, lower, gate, write."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path
from typing import Any, Final, get_args

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.config.tree import Config
from contract.errors import ExportError
from contract.recording import dataset
from contract.recording.dataset import Episode
from export.program.controller_program import ControllerProgram
from export.program.from_training import load_trained
from export.program.recorded_windows import recorded_windows
from export.program.weights import Array
from export.release.bundle import ReleaseReport, write_release
from export.release.c_folder import CReport, write_c_release
from export.to_onnx.weights import Precision

GATE_WINDOWS: Final = 50
"""Consecutive recorded windows that the export gates replay."""
CALIBRATION_WINDOWS: Final = 400
"""Recorded windows from which int8 rounding is calibrated, of every kind of forcing together."""


@dataclass(frozen=True, kw_only=True)
class Exported:
    """What was written, and what its gates measured; no library where none was asked for."""

    release: ReleaseReport
    library: CReport | None

    def gates(self) -> Iterator[tuple[str, Any]]:
        """Every figure of every gate by its name."""
        parts = {
            "graph against reference": self.release.parity,
            "int8 against float32": self.release.quantisation,
            "C against reference": self.library and self.library.parity,
            "int8 C against float32": self.library and self.library.quantisation,
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
) -> Exported:
    """Write the C library, if a folder is given for it, and then the bundle.

    Args:
        model: directory written by `train`.
        precision: "int8" or "float32", of both.
        recording: data set whose test episode the gates replay, and whose training episodes calibrate int8.
        created: today.
        key: to sign the bundle with; unsigned if None.

    Raises:
        ExportError: the model does not fit, or a lowering does not pass its gates.
        StillwakeError: a file cannot be read or written.
    """
    kinds: dict[str, Precision] = {kind: kind for kind in get_args(Precision)}
    if precision not in kinds:
        raise ExportError(f"--precision {precision}: must be int8 or float32")
    trained = load_trained(model)
    program = trained.program(config.mpc)
    episodes = dataset.read(recording)
    windows = recorded_windows(program, episodes.with_role("test")[0], GATE_WINDOWS)
    calibration = calibration_windows(program, episodes.with_role("train"))
    library = None
    if c_folder is not None:
        library = write_c_release(
            c_folder, program, precision=kinds[precision], windows=windows, calibration=calibration
        )
    provenance = dict(trained.provenance)
    release = write_release(
        output,
        program,
        precision=kinds[precision],
        name=name,
        operating_point=config.operating_point,
        budget_ms=config.period_ns / 1e6,
        compute_time_ms=config.ecu.compute_time_ms,
        control_period=config.flow.control_period,
        created=created,
        dataset_sha256=provenance.pop("dataset_sha256"),
        weights_sha256=provenance.pop("weights_sha256"),
        provenance=provenance,
        windows=windows,
        calibration=calibration,
        key=key,
    )
    return Exported(release=release, library=library)
