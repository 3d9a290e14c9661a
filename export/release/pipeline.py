"""The export of a model folder as a release bundle and, on request, a C library, after every gate."""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path
from typing import Any, Final

import numpy as np
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.arrays import Array
from contract.config.tree import Config
from contract.controller import c_folder as c_folder_format
from contract.controller.c_folder import BILL, EXPECTED, RECORDED, rows_text, write_folder
from contract.controller.image_payload import with_layout
from contract.controller.interface import CompileLibrary
from contract.errors import ExportError
from contract.model import model_folder
from contract.model.model_folder import ModelFolder
from contract.recording import dataset
from contract.recording.dataset import Dataset
from contract.recording.episode import Episode
from contract.recording.needs import CALIBRATION_WINDOWS as CALIBRATION_WINDOWS
from contract.recording.needs import GATE_WINDOWS as GATE_WINDOWS
from contract.recording.needs import LEAST_CALIBRATION, windows_in
from contract.release import bundle
from contract.release.bundle import MadeEstimator, with_estimator
from contract.release.checks import CONTROLLER, Bundle
from contract.release.manifest import FIRST_SECURITY_VERSION, PRECISIONS, Manifest, SpeedRange
from contract.runtime.onnx_session import OnnxEstimator
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK
from export.int8 import rounded_on
from export.program.controller_program import ControllerProgram, program_of, recorded_windows
from export.release.gated import Gated, Lowered, gate, lower
from export.to_c.builds import build_files
from export.to_c.library import documents

EXPORT_PHASES: Final = ("read", "round weights", "make and check", "write")
"""The phases of an export, in order."""


@dataclass(frozen=True, kw_only=True)
class CLibrary:
    """The C library that an export writes. `compiled` compiles the library for its gate. `ecu` returns the files and
    documents of the ECU, which calls the control step, from the written release and the folder's recorded rows (n,
    S+1). `bill` returns the bill of materials, from all files of the folder and the release."""

    folder: Path
    compiled: CompileLibrary
    ecu: Callable[[Bundle, Array], Mapping[str, bytes]] | None = None
    bill: Callable[[Mapping[str, bytes], Bundle], bytes] | None = None


def gate_figures(gated: Gated) -> Iterator[tuple[str, Any]]:
    """Yield every figure of every gate as a pair of name and value."""
    parts = {
        "graph against reference": gated.graph.parity,
        "int8 against float32": gated.graph.quantisation,
        "C against reference": gated.library and gated.library.parity,
        "int8 C against float32": gated.library and gated.library.quantisation,
    }
    for title, part in parts.items():
        for name, value in (part or {}).items():
            yield f"{title}: {name}", value


def calibration_windows(
    program: ControllerProgram, episodes: Sequence[Episode], layout: SensorLayout = TRUCK
) -> list[Array]:
    """Return up to about `CALIBRATION_WINDOWS` windows (L, S+1). The windows are from the last episode of each kind
    of forcing, because the networks' inputs differ between kinds. An episode with fewer than `LEAST_CALIBRATION`
    windows is not used. An episode whose provenance states no forcing counts as a separate kind. Raises ExportError if
    all episodes are too short; the message states the longest episode."""
    held = {item.name: windows_in(len(item), program.window) for item in episodes}
    last = {
        str(item.provenance.get("forcing_signal", f"of {item.name}")): item
        for item in episodes
        if held[item.name] >= LEAST_CALIBRATION
    }.values()
    if not last:
        longest = max(episodes, key=len)
        raise ExportError(
            f"training episodes are too short to calibrate int8: the longest, {longest.name}, has {len(longest)} "
            f"steps, but {LEAST_CALIBRATION} windows need {program.window - 1 + LEAST_CALIBRATION}; "
            f"--precision float32 needs no windows"
        )
    found: list[Array] = []
    for item in last:
        count = min(CALIBRATION_WINDOWS, held[item.name])
        found += recorded_windows(program, item, count, layout)[:: max(1, count * len(last) // CALIBRATION_WINDOWS)]
    return found


def gate_windows(program: ControllerProgram, episodes: Sequence[Episode], layout: SensorLayout = TRUCK) -> list[Array]:
    """Return the last `GATE_WINDOWS` windows (L, S+1) of the first episode that has this number of windows. Raises
    ExportError if all episodes are too short; the message states the longest episode."""
    long_enough = (item for item in episodes if windows_in(len(item), program.window) >= GATE_WINDOWS)
    return recorded_windows(program, next(long_enough, max(episodes, key=len)), GATE_WINDOWS, layout)


def export_all(
    model: Path,
    output: Path,
    *,
    name: str,
    recording: Path,
    config: Config,
    created: date,
    precision: str = "int8",
    library: CLibrary | None = None,
    key: Ed25519PrivateKey | None = None,
    named: bool = True,
    estimator: MadeEstimator | None = None,
    notice: Callable[[str], None] = lambda line: None,
    phase: Callable[[str], None] = lambda name: None,
) -> tuple[Gated, Bundle]:
    """Export a model as a bundle, load the written bundle, and write the C library if requested. Nothing is written
    until both the bundle's graph and the library have passed their gates.

    Args:
        model: directory written by `train`.
        recording: data set whose test episode the gates replay, and whose training episodes calibrate int8.
        config: `config.mpc` is used for the controller; control period and action limit must equal the model's values.
        precision: "int8" or "float32", for bundle and library.
        key: key to sign the bundle with; the bundle is unsigned if None.
        named: whether the user named the recording. If not, the model must have been fitted to the recording.
        estimator: a sensor estimator for the bundle.
        notice: called with a line of text if the model was fitted to another recording.
        phase: called with each of `EXPORT_PHASES` when the phase begins.

    Raises ModelError or DatasetError if the model directory or the recording is not valid; ExportError if the recording
    or its sensors do not fit the model, the settings have another control period or action limit, the model's weights
    are inconsistent, or a lowering does not pass its gates; LibraryError if there is no C compiler for a requested
    library; StillwakeError if a file cannot be read or written.
    """
    if precision not in PRECISIONS:
        raise ExportError(f"--precision {precision}: must be int8 or float32")
    # Both outputs are checked before any work, so that the export does not write one output and then fail at the other.
    bundle.check_replaceable(output)
    if library is not None:
        c_folder_format.check_replaceable(library.folder)
    phase("read")
    trained = model_folder.read(model)
    about = trained.description
    check_settings(about.config, config)
    episodes = _recording_of(recording, about.dataset_sha256, about.layout, named, notice)
    program = program_of(trained, config.mpc)
    lowered, windows = _lowered(program, episodes, precision, with_library=library is not None, phase=phase)
    gated = gate(lowered, windows, compiled=None if library is None else library.compiled)
    phase("write")
    write_release(output, gated, trained, name=name, created=created, config=config, key=key, estimator=estimator)
    release = bundle.load(output)
    if library is not None:
        write_c_release(library, release, gated, windows)
    return gated, release


def export_library(
    model: Path, release: Bundle, library: CLibrary, *, recording: Path, phase: Callable[[str], None] = lambda _: None
) -> Gated:
    """Write the C library of an existing release. The library is computed from the release's model and settings, and
    from the recording to which the model was fitted. Raises ExportError if `model` is not the release's model, or
    rounding gives other integers than in the release; StillwakeError as `export_all` does."""
    c_folder_format.check_replaceable(library.folder)
    manifest = release.manifest
    phase("read")
    trained = model_folder.read(model)
    if trained.weights_sha256 != manifest.weights_sha256:
        raise ExportError(
            f"bundle {manifest.name} was made from the model {manifest.weights_sha256[:12]}, but {model} is "
            f"the model {trained.weights_sha256[:12]}: give the model of the bundle"
        )
    about = trained.description
    episodes = _recording_of(recording, about.dataset_sha256, about.layout, False, lambda line: None)
    program = program_of(trained, manifest.mpc)
    lowered, windows = _lowered(program, episodes, manifest.precision, with_library=True, phase=phase)
    if lowered.program_sha256 != manifest.program_sha256:
        raise ExportError(
            f"bundle {manifest.name} has the program {manifest.program_sha256[:12]}, but its model gives "
            f"{lowered.program_sha256[:12]} here: export the model to a new bundle"
        )
    gated = gate(lowered, windows, compiled=library.compiled)
    phase("write")
    write_c_release(library, release, gated, windows)
    return gated


def _lowered(
    program: ControllerProgram, episodes: Dataset, precision: str, *, with_library: bool, phase: Callable[[str], None]
) -> tuple[Lowered, list[Array]]:
    windows = gate_windows(program, episodes.with_role("test"), episodes.layout)
    calibration: list[Array] = []
    if precision == "int8":
        calibration = calibration_windows(program, episodes.with_role("train"), episodes.layout)
    phase("round weights")
    rounded = rounded_on(program, calibration) if precision == "int8" else program
    phase("make and check")
    return lower(rounded, calibration=calibration, with_library=with_library), windows


def check_settings(own: Config, config: Config) -> None:
    """Raise ExportError if control period or action limit differ from the model, or if the computing time exceeds the
    period. The manifest would refuse such settings only after the lowerings have passed their gates."""
    period_ms = config.period_ns / 1e6
    if config.ecu.compute_time_ms > period_ms:
        raise ExportError(
            f"ecu.compute_time_ms = {config.ecu.compute_time_ms:g}: must be within the control period of "
            f"{period_ms:g} ms (flow.control_period times W / U_inf of operating_point)"
        )
    for name in ("control_period", "action_limit"):
        trained, here = getattr(own.flow, name), getattr(config.flow, name)
        if trained != here:
            raise ExportError(
                f"flow.{name} = {here:g} in the settings, but the model was trained with {trained:g}: "
                f"a controller must have its model's value"
            )


def _recording_of(
    path: Path, of_model: str, layout: SensorLayout, named: bool, notice: Callable[[str], None]
) -> Dataset:
    """Read the recording to which the model was fitted, or another one with its sensors if the user named it."""
    recording = dataset.read(path)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    if digest != of_model:
        other = f"{path} (SHA-256 {digest[:12]}) is not the recording that the model was fitted to ({of_model[:12]})"
        if not named:
            raise ExportError(f"{other}: name the model's recording with --dataset")
        difference = layout.difference(recording.layout)
        if difference is not None:
            raise ExportError(f"{other}, and the sensors differ: {difference}")
        notice(f"gates and calibration: {other}")
    return recording


def write_release(
    path: Path,
    gated: Gated,
    trained: ModelFolder,
    *,
    name: str,
    created: date,
    config: Config,
    key: Ed25519PrivateKey | None = None,
    estimator: MadeEstimator | None = None,
) -> None:
    """Write a release bundle of a trained model, completely or not at all; the gates' figures are added to the model's
    provenance under `export`. `config` has the vehicle's operating point, control period, and time allowed for a
    control step. Without `key` the release is unsigned; without `estimator` the ECU does not check its sensors. Raises
    StillwakeError if the path cannot be written, or contains something other than a bundle; BundleControllerError if
    the estimator is for other sensors or another window."""
    lowered, program, about = gated.lowered, gated.lowered.effective, trained.description
    positions = about.layout.positions[about.layout.indices(program.sensors)]
    # A prior that was trained for the design speed only, and a model without a prior, have no range of speeds. The
    # settings of a model without a prior may state a range if `train` and `refine` share a file of settings.
    refined = {} if program.prior is None else trained.config_tree.get("refine", {})
    slowest, fastest = refined.get("slowest", 1.0), refined.get("fastest", 1.0)
    training = {"metrics": about.metrics, "versions": about.versions, "config": trained.config_tree}
    manifest = Manifest(
        name=name,
        created=created.isoformat(),
        precision=lowered.precision,
        sensors=program.sensors,
        sensor_positions=tuple((float(x), float(y)) for x, y in positions),
        window=program.window,
        action_limit=program.action_limit,
        mpc=program.mpc,
        scaling=program.scaling,
        operating_point=config.operating_point,
        control_period=config.flow.control_period,
        budget_ms=config.period_ns / 1e6,
        compute_time_ms=config.ecu.compute_time_ms,
        dataset_sha256=about.dataset_sha256,
        weights_sha256=trained.weights_sha256,
        program_sha256=lowered.program_sha256,
        provenance={**training, "export": asdict(gated.graph)},
        security_version=FIRST_SECURITY_VERSION,
        speeds=SpeedRange(slowest=slowest, fastest=fastest) if slowest < fastest else None,
        resting=trained.resting,
        air_speed=trained.air_speed,
    )
    contents = {CONTROLLER: lowered.graph}
    if estimator is not None:
        manifest = with_estimator(manifest, contents, estimator)
        OnnxEstimator.of(Bundle(manifest=manifest, files=contents, digest=""))
    bundle.write(path, manifest, contents, key)


def write_c_release(library: CLibrary, release: Bundle, gated: Gated, windows: Sequence[Array]) -> None:
    """Write the library's folder, with the rows of consecutive recorded windows (L, S+1), completely or not at all.
    Raises LibraryError if the folder contains anything else; StillwakeError if it cannot be written."""
    assert gated.lowered.library is not None
    assert gated.library is not None
    rows = rows_of(windows)
    files = with_layout({**gated.lowered.library, **({} if library.ecu is None else library.ecu(release, rows))})
    contents = {**files, **documents(files), **build_files(files)}
    contents |= {RECORDED: rows_text(rows).encode(), EXPECTED: rows_text(gated.library.replayed).encode()}
    if library.bill is not None:
        contents[BILL] = library.bill(contents, release)
    write_folder(library.folder, contents)


def rows_of(windows: Sequence[Array]) -> Array:
    """Return the n different rows of consecutive windows (L, S+1), as an array (n, S+1)."""
    return np.concatenate([windows[0], *(window[-1:] for window in windows[1:])])
