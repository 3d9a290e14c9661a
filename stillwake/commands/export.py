"""The commands that lower a trained model: to a release bundle and a C library, and onto an emulated Cortex-M7."""

import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from datetime import date
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from can_bridge.wire.messages import SENSORS
from contract.config.loading import from_tree, load
from contract.config.tree import Config
from contract.controller.c_folder import SETTINGS as C_SETTINGS
from contract.errors import ConfigError, ConflictError, ModelError, OutputError, StillwakeError
from contract.model import model_folder
from contract.release import bundle as bundles
from contract.release.checks import Bundle
from contract.release.container import read_files
from contract.release.controller_image import SUFFIX
from contract.release.signing import public_key, read_private_key
from contract.shipped import recording
from stillwake.console.outputs import Overwrite, check_json, check_output, save_json
from stillwake.console.settings import settings
from stillwake.console.terminal import ConfigFile, JsonFile, Overrides, Threads, console, phases_bar, print_table
from stillwake.parts.fitted_estimator import fitted_estimator
from stillwake.parts.releases import open_release

_LIBRARY: Final = "there is a C library already"

USES: Final = ("mpc", "operating_point", "ecu.compute_time_ms")
"""Settings of a release that its model does not fix."""
USES_IN_C: Final = ("bus", "ecu")
"""More of them, which the ECU of a C library is compiled with."""


def export(
    model: Annotated[
        Path | None,
        typer.Argument(help="Model directory written by `train`. Default: the shipped one."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Argument(help="Bundle directory to write. Left out, --c and --fmu are of the shipped bundle."),
    ] = None,
    precision: Annotated[str, typer.Option(help="int8 (weights) or float32.")] = "int8",
    name: Annotated[str, typer.Option(help="Name of the release.")] = "truck-wake",
    dataset: Annotated[
        Path | None,
        typer.Option(
            help="Data set that the model was trained on; the checks replay it. Default: the shipped recording."
        ),
    ] = None,
    c_folder: Annotated[Path | None, typer.Option("--c", help="Also write the C99 library into this folder.")] = None,
    fmu: Annotated[
        Path | None,
        typer.Option(help="Also write the ECU as an FMU for co-simulation, FMI 3.0 (.fmu); needs a C compiler."),
    ] = None,
    image: Annotated[
        Path | None,
        typer.Option(help="Also write the release as an image (.swi), which an ECU in C of the same layout runs."),
    ] = None,
    sensors: Annotated[
        bool,
        typer.Option(
            "--sensors", help="Also fit a sensor estimator, so that the ECU finds sensors that lie: takes minutes."
        ),
    ] = False,
    threads: Threads = 1,
    key: Annotated[
        Path | None, typer.Option(help="Sign bundle and image with this private key (`bundle keygen`).")
    ] = None,
    overwrite: Overwrite = False,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Turn a trained model into a controller: one ONNX graph of a control step, in a release bundle.

    Settings are those that the model was trained with; --config and --set go
    on top, for example --set mpc.weights.lift=0.1. Nothing is written unless
    the graph agrees with the reference computation in NumPy, and so does the
    C library where one is asked for. The folder of --c has the whole ECU in C
    as well, with the settings of the sections bus and ecu compiled in, its
    DBC, A2L and PDX, and a bill of materials.
    `export --c FOLDER` alone writes that folder for the shipped bundle, and
    `export --fmu FILE` its ECU as an FMU, `export --image FILE` its image.
    """
    in_c = any(path is not None for path in (c_folder, fmu, image))
    signing_key = None if key is None else read_private_key(key)
    if model is None or output is None:
        if model is not None or not in_c or sensors or (key is not None and image is None) or dataset is not None:
            raise OutputError(
                "no BUNDLE to write: name MODEL and BUNDLE, or --c FOLDER alone, or --fmu or --image FILE, of the "
                "shipped bundle"
            )
        _check_in_c(c_folder, fmu, image, overwrite=overwrite)
        _export_shipped(c_folder, fmu, image, signing_key, config_file, overrides)
        return
    config = _settings(model, config_file, overrides, uses=(*USES, *USES_IN_C) if in_c else USES)
    check_output(output, overwrite=overwrite, folder=True, occupant=_description(output))
    check_output(output.with_name(f"{output.name}.cdx.json"), overwrite=overwrite)
    _check_in_c(c_folder, fmu, image, overwrite=overwrite)
    if in_c:
        _check_c_settings(config)

    from export.release.pipeline import PHASES, CLibrary, export_all, gate_figures
    from export.release.sbom import folder_bom, release_bom, write_bom
    from firmware_sim.in_c.host_library import CController
    from stillwake.parts.c_release import ecu_files

    used = recording() if dataset is None else dataset
    library = None
    with _library_folder(c_folder) as folder, phases_bar("export", PHASES) as (bar, phase):
        if in_c:
            ecu = partial(ecu_files, output, config=config, notice=console.print)
            library = CLibrary(
                folder=folder, compiled=CController, ecu=ecu, bill=lambda files: folder_bom(files, bundles.load(output))
            )
        done = export_all(
            model,
            output,
            name=name,
            recording=used,
            config=config,
            created=date.today(),
            precision=precision,
            library=library,
            key=signing_key,
            named=dataset is not None,
            estimator=partial(fitted_estimator, used, bar, threads=threads) if sensors else None,
            notice=console.print,
            phase=phase,
        )
        release = bundles.load(output)
        bill = write_bom(output, release_bom(release, read_files(output)))
        _write_files(fmu, image, folder, release, config, signing_key)
    print_table("check", "measured", rows=_measured(gate_figures(done)))
    size = f"controller.onnx {done.graph.controller_bytes / 1024:.0f} KiB"
    console.print(f"wrote {output}: {done.lowered.precision}, {size}, {_signed(signing_key)}")
    console.print(f"wrote {bill}: bill of materials, CycloneDX 1.6")
    point = config.operating_point
    console.print(
        f"for a body {point.width:g} m wide at {point.speed:g} m/s, a control period of {config.period_ns / 1e6:g} ms: "
        f"--set operating_point.width and operating_point.speed make it another",
    )
    count = len(done.lowered.effective.sensors)
    if count != SENSORS:
        console.print(
            f"{count} sensors: the ECU here takes {SENSORS}, as its Pressure message does (train.sensors={SENSORS}); "
            f"the control step in C and the ONNX graph work with any number",
        )
    if done.library is not None:
        workspace = f"{done.library.workspace_bytes / 1024:.0f} KiB of workspace"
        if c_folder is not None:
            console.print(f"wrote {c_folder}: C99, {done.lowered.precision}, {workspace}")
        _print_files(fmu, image, signing_key)


def _check_in_c(folder: Path | None, fmu: Path | None, image: Path | None, *, overwrite: bool) -> None:
    """Refuse places for a library, an FMU and an image; see `check_output`."""
    if folder is not None:
        check_output(folder, overwrite=overwrite, folder=True, occupant=_LIBRARY, mark=C_SETTINGS)
    for option, path, suffix in (("--fmu", fmu, ".fmu"), ("--image", image, SUFFIX)):
        if path is not None and path.suffix.lower() != suffix:
            raise OutputError(f"{option} {path}: must be a file ending in {suffix}")
        if path is not None:
            check_output(path, overwrite=overwrite)


def _check_c_settings(config: Config) -> None:
    """Refuse settings that the ECU in C cannot do, whatever the release is."""
    from firmware_sim.in_c.c_settings import check_settings

    if config.bus.key:
        raise ConflictError(
            "bus.key: the ECU in C has no authentication yet, so --c, --fmu and --image are of one without; "
            "leave bus.key empty for them"
        )
    check_settings(config)


@contextmanager
def _library_folder(given: Path | None) -> Iterator[Path]:
    """Where a library is written: the place that was given, or one that lasts as long as the block."""
    with tempfile.TemporaryDirectory() as scratch:
        yield Path(scratch, "library") if given is None else given


def _write_files(
    fmu: Path | None,
    image: Path | None,
    library: Path,
    release: Bundle,
    config: Config,
    key: Ed25519PrivateKey | None,
) -> None:
    from stillwake.parts.c_release import write_fmu, write_image

    if fmu is not None:
        write_fmu(fmu, library, release, config)
    if image is not None:
        write_image(image, library, release, config, key)


def _print_files(fmu: Path | None, image: Path | None, key: Ed25519PrivateKey | None) -> None:
    if image is not None:
        console.print(f"wrote {image}: {image.stat().st_size / 1024:.1f} KiB, {_signed(key)}")
    if fmu is not None:
        console.print(f"wrote {fmu}: FMI 3.0 co-simulation, compiled for this machine, with its sources")


def _export_shipped(
    c_folder: Path | None,
    fmu: Path | None,
    image: Path | None,
    key: Ed25519PrivateKey | None,
    file: Path | None,
    overrides: list[str],
) -> None:
    """The shipped bundle's library, FMU and image, with the vehicle's settings compiled in."""
    config = settings("export --c", file, overrides, uses=USES_IN_C).config
    _check_c_settings(config)

    from export.release.pipeline import PHASES, gate_figures
    from export.release.sbom import folder_bom
    from stillwake.parts.c_release import write_shipped_library

    release = open_release(None, None)
    with _library_folder(c_folder) as folder, phases_bar("export", PHASES) as (_, phase):
        bill = partial(folder_bom, bundle=release)
        done = write_shipped_library(folder, release, config, bill=bill, notice=console.print, phase=phase)
        _write_files(fmu, image, folder, release, config, key)
    print_table("check", "measured", rows=_measured(gate_figures(done)))
    if c_folder is not None:
        console.print(f"wrote {c_folder}: C99, {release.manifest.name}")
    _print_files(fmu, image, key)


def _signed(key: Ed25519PrivateKey | None) -> str:
    return "unsigned" if key is None else f"signed by key {public_key(key).fingerprint}"


def _measured(figures: Iterable[tuple[str, Any]]) -> Iterator[tuple[str, str]]:
    for title, value in figures:
        yield title, f"{value:.3g}" if isinstance(value, float) else str(value)


def _settings(model: Path, file: Path | None, overrides: list[str], *, uses: Sequence[str] = USES) -> Config:
    """The model's own, with what the user gives on top."""
    try:
        own = model_folder.read_description(model)["config"]
    except ModelError:
        # As for every other command, a setting that does not exist comes first.
        load(file, overrides)
        raise
    try:
        base = from_tree(own)
    except ConfigError as error:
        raise ModelError(f"model {model}: {model_folder.DESCRIPTION}: {error}") from error
    return settings("export", file, overrides, uses=uses, base=base).config


def _description(bundle: Path) -> str:
    """What lies where a bundle is to be written, in words."""
    try:
        there = bundles.load(bundle)
    except StillwakeError:
        return "something is there already"
    if there.signer is None:
        return f"there is the bundle {there.manifest.name} already, unsigned"
    return f"there is the bundle {there.manifest.name} already, signed by key {there.signer.fingerprint}"


def mcu(
    library: Annotated[
        Path | None, typer.Argument(help="Folder written by `export --c`. Default: the shipped bundle's library.")
    ] = None,
    json_file: JsonFile = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Compile the C library for a Cortex-M7, replay its recorded rows on an emulated one, compare with this host.

    The last lines report whether a step fits into the control period of the operating point.
    """
    config = settings("mcu", config_file, overrides, uses=["operating_point", "flow.control_period"]).config
    check_json(json_file)

    from firmware_sim.mcu.measure import PHASES, measure_folder, verdicts
    from stillwake.parts.c_release import library_folder

    with phases_bar("Cortex-M7", PHASES) as (_, phase), library_folder(library) as folder:
        measured = measure_folder(folder, phase=phase)
    rows = (*measured.rows(), *verdicts(measured.modelled_ms, config.period_ns / 1e6))
    print_table("one control step on a Cortex-M7", "", rows=rows)
    facts = {"library": "shipped" if library is None else str(library), "period_ms": config.period_ns / 1e6}
    save_json(json_file, figures=asdict(measured), facts=facts)
