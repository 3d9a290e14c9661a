"""From a linear model folder to a release bundle and, on request, a C library: read, lower, gate, write."""

import hashlib
from collections.abc import Callable, Mapping
from datetime import date
from pathlib import Path
from typing import Final

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.arrays import Array
from contract.config.tree import Config
from contract.controller import c_folder as c_folder_format
from contract.controller.interface import CompileLibrary
from contract.errors import ExportError
from contract.model import linear_model_folder
from contract.model.linear_model_folder import LinearDescription
from contract.recording import dataset
from contract.recording.episode import Episode
from contract.release import bundle
from contract.release.bundle import MadeEstimator
from contract.release.manifest import Manifest
from contract.sensor_layout import SensorLayout
from export.program.linear_program import LinearProgram
from export.release.bundle import Vehicle, write_release
from export.release.c_folder import rows_of, write_c_release
from export.release.gated import Gated, gate
from export.release.lowering import lower_linear
from export.release.pipeline import check_settings, gate_windows

PHASES: Final = ("read", "make and check", "write")
"""Of an export, in order."""


def export_linear(
    model: Path,
    output: Path,
    *,
    name: str,
    recording: Path,
    config: Config,
    c_folder: Path | None,
    created: date,
    key: Ed25519PrivateKey | None = None,
    named: bool = True,
    estimator: Callable[[Manifest], MadeEstimator] | None = None,
    compiled: CompileLibrary | None = None,
    ecu: Callable[[Path, Array], Mapping[str, bytes]] | None = None,
    notice: Callable[[str], None] = lambda line: None,
    phase: Callable[[str], None] = lambda name: None,
) -> Gated:
    """Write the bundle, and then the C library if a folder is given for it; neither unless both pass their gates.

    Args:
        model: directory written by `identify`.
        recording: data set whose rows the gates replay: of the model's own episodes, if it is the model's.
        config: its `mpc` has the horizon and the weights of the reported cost.
        estimator, compiled, ecu, notice, phase and the others: as `export.release.pipeline.export_all` has them.

    Raises:
        ModelError: the model directory is not sound.
        DatasetError: the recording is not sound.
        ExportError: the recording is not the model's and was not named; the settings are of another control period,
            action limit or window; a lowering does not pass its gates.
        LibraryError: there is no C compiler for a library that is asked for.
        StillwakeError: a file cannot be read or written.
    """
    bundle.check_replaceable(output)
    if c_folder is not None:
        c_folder_format.check_replaceable(c_folder)
    phase("read")
    found = linear_model_folder.read(model)
    about = found.description
    check_settings(about.config, config)
    program = LinearProgram.of(found, config.mpc)
    episodes, layout = _episodes(about, recording, named, notice)
    windows = gate_windows(program, episodes, layout)
    phase("make and check")
    gated = gate(lower_linear(program, with_library=c_folder is not None), windows, compiled=compiled)
    phase("write")
    write_release(
        output,
        gated,
        name=name,
        created=created,
        vehicle=Vehicle.of(config),
        provenance=found.provenance,
        positions=about.positions,
        key=key,
        estimator=estimator,
    )
    if c_folder is not None:
        write_c_release(c_folder, gated, windows, None if ecu is None else ecu(output, rows_of(windows)))
    return gated


def _episodes(
    about: LinearDescription, path: Path, named: bool, notice: Callable[[str], None]
) -> tuple[tuple[Episode, ...], SensorLayout]:
    """The model's own episodes, or all of another recording if it was named."""
    found = dataset.read(path)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    if digest == about.dataset_sha256:
        own = about.metrics.get("episodes", ())
        return tuple(item for item in found.episodes if item.name in own) or found.episodes, found.layout
    said = (
        f"{path} (SHA-256 {digest[:12]}) is not the recording that the model was identified from "
        f"({about.dataset_sha256[:12]})"
    )
    if not named:
        raise ExportError(f"{said}: name that one with --dataset")
    notice(f"gates: {said}")
    return found.episodes, found.layout
