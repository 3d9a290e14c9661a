"""The commands that export a trained model: to a release bundle and a C library, and to an emulated Cortex-M7."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Final

import typer
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from can_bridge.wire.messages import SENSORS
from contract.atomic import write_files
from contract.config.loading import from_tree
from contract.config.tree import Config
from contract.controller.c_folder import PROGRAM_SETTINGS, read_recorded, read_sources
from contract.errors import ConfigError, ConflictError, ModelError, OutputError, StillwakeError
from contract.model import model_folder
from contract.release import bundle as bundles
from contract.release.checks import Bundle
from contract.release.container import read_files
from contract.release.controller_image import FORMATS, name_bytes
from contract.release.signing import public_key, read_private_key
from contract.shipped import recording
from firmware_sim.fmu.kinds import FmuKind, kind_and_path
from stillwake.console import options as shared
from stillwake.console.outputs import check_apart, check_json, check_output, save_json
from stillwake.console.progress import phases
from stillwake.console.settings import TESTERS_BUS, read_settings, settings
from stillwake.console.terminal import console, print_table
from stillwake.parts.c_release import (
    A2L,
    c_library,
    descriptions,
    library_folder,
    write_fmu,
    write_image,
    write_shipped_library,
)
from stillwake.parts.releases import open_release
from stillwake.parts.training import fitted_estimator

if TYPE_CHECKING:
    from export.release.gated import Gated

_LIBRARY: Final = "holds a C library already"
_NO_BUNDLE: Final = (
    "no BUNDLE to write: name MODEL and BUNDLE, also for --precision, --name, --dataset, --estimator; for the shipped "
    "bundle, give --c, --fmu, --image or --for-testers without MODEL; --for-testers accepts another bundle as MODEL"
)

USES: Final = ("mpc", "operating_point", "ecu.compute_time_ms")
"""Settings that may differ between a release and its model."""
USES_IN_C: Final = ("bus", "ecu")
"""Sections of settings that are compiled into the ECU of a C library."""
USES_FOR_TESTERS: Final = (
    *TESTERS_BUS,
    *("operating_point", "flow.control_period", "flow.action_limit"),
    *("ecu.command_step", "ecu.delay_steps", "ecu.plan_ahead"),
)
"""Settings that the files for testers depend on."""

Fmu = Annotated[
    str | None,
    typer.Option(
        metavar="[KIND,..:]FILE",
        help="Also write the ECU as an FMU; needs a C compiler. Kinds: bus (a CAN terminal in place of signals), "
        "triggered (bus for fixed steps), fmi2 (FMI 2.0), windows (for Windows too; needs ziglang).",
    ),
]
ForTesters = Annotated[Path | None, typer.Option(help="Also write the ECU's DBC, A2L, PDX and seed-and-key rule here.")]
Key = Annotated[Path | None, typer.Option(help="Private key file (PEM) to sign bundle and image with (`keygen`).")]


def export(
    model: Annotated[
        Path | None, typer.Argument(help="Model directory written by `train`; default: the shipped model.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Argument(
            metavar="BUNDLE", help="Bundle directory to write; without it, files are for the shipped bundle."
        ),
    ] = None,
    precision: Annotated[str | None, typer.Option(help="int8 (default) or float32.")] = None,
    name: Annotated[str | None, typer.Option(help="Name of the release; default: truck-wake.")] = None,
    dataset: shared.DataSet = None,
    c: Annotated[Path | None, typer.Option("--c", help="Also write the C99 library into this folder.")] = None,
    fmu: Fmu = None,
    image: Annotated[Path | None, typer.Option(help="Also write the release as an image (.swi, .hex, .s19).")] = None,
    for_testers: ForTesters = None,
    estimator: Annotated[bool, typer.Option("--estimator", help="Fit a sensor estimator, too; takes minutes.")] = False,
    key: Key = None,
    overwrite: shared.Overwrite = False,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Turn a trained model into a controller: one ONNX graph of a control step, in a release bundle.

    The command starts from the settings with which the model was trained; --set changes them, for example --set
    mpc.weights.lift=0.1. Nothing is written unless the graph, and the C library if requested, agree with the reference
    computation in NumPy. For this comparison the graph, the library and the reference compute control steps on the data
    set with which the model was trained. The folder of --c also has the whole ECU in C, with the settings of the
    sections bus and ecu compiled in. The folder further has the ECU's DBC, A2L and PDX files, the computation of a
    tester's key from the ECU's seed, and a bill of materials.

    Without a model, `export --c FOLDER` writes this folder for the shipped bundle, `export --fmu FILE` writes the
    shipped bundle's ECU as an FMU, and `export --image FILE` writes the shipped bundle's image. `export --for-testers
    FOLDER` writes the files for testers of the shipped bundle, and `export BUNDLE --for-testers FOLDER` writes the
    files of another bundle; neither command needs an ECU.
    """
    of_fmu, private = None if fmu is None else kind_and_path(fmu), None if key is None else read_private_key(key)
    files = _Files(c=c, fmu=of_fmu, image=image, for_testers=for_testers, key=private)
    any_file = files.in_c or for_testers is not None
    check_apart(output or model, c, of_fmu and of_fmu[1], image, for_testers)
    if image is not None and name is not None:
        name_bytes("name", name)
    if output is None:
        is_of_shipped = any_file and not (files.in_c and model) and (image or not key)
        if not is_of_shipped or estimator or (precision, name, dataset) != (None, None, None):
            raise OutputError(_NO_BUNDLE)
        files.check(overwrite=overwrite)
        if files.in_c:
            _export_shipped(files, given)
        else:
            files.write_for_testers(open_release(model), settings("export", given, uses=USES_FOR_TESTERS).config)
        return
    assert model is not None
    check_apart(model, output)
    config = _settings(model, given, uses=(*USES, *USES_IN_C) if any_file else USES)
    check_output(output, overwrite=overwrite, folder=True, occupant=_description(output))
    check_output(output.with_name(f"{output.name}.cdx.json"), overwrite=overwrite)
    files.check(overwrite=overwrite)
    if files.in_c:
        files.check_in_c(config)
    if (fmu, image, for_testers) != (None, None, None):
        # These files contain or describe the ECU, which must be able to run the model; --c can also omit the ECU.
        from ecu.fit import check_ecu

        sensors = len(model_folder.read(model).description.sensors)
        check_ecu(f"model {model}", sensors, config.mpc.horizon, config.ecu)
    _export_model(model, output, files, config, dataset, name=name, precision=precision, estimator=estimator)


@dataclass(frozen=True, kw_only=True)
class _Files:
    """The files that are written for a new or an existing bundle."""

    c: Path | None
    fmu: tuple[FmuKind, Path] | None
    image: Path | None
    for_testers: Path | None
    key: Ed25519PrivateKey | None

    @property
    def in_c(self) -> bool:
        """Whether the C library is needed, for its own folder or to make the FMU or the image."""
        return (self.c, self.fmu, self.image) != (None, None, None)

    def check(self, *, overwrite: bool) -> None:
        """Check that the files can be written; see `check_output`."""
        if self.c is not None:
            check_output(self.c, overwrite=overwrite, folder=True, occupant=_LIBRARY, mark=PROGRAM_SETTINGS)
        if self.for_testers is not None:
            if (self.for_testers / PROGRAM_SETTINGS).exists():
                raise OutputError(f"{self.for_testers}: {_LIBRARY}; name another folder")
            check_output(self.for_testers, overwrite=overwrite, folder=True, mark=A2L)
        if self.image is not None and self.image.suffix.lower() not in FORMATS:
            raise OutputError(f"--image {self.image}: must be a file ending in {' or '.join(FORMATS)}")
        for path in filter(None, (self.fmu and self.fmu[1], self.image)):
            check_output(path, overwrite=overwrite)

    def check_in_c(self, config: Config) -> None:
        """Raise an error for settings that the ECU in C never supports, whatever the release."""
        from ecu.fit import check_offset
        from ecu.in_c.c_settings import check_settings

        if self.fmu is not None and config.bus.key:
            raise ConflictError("bus.key: an FMU cannot authenticate frames; leave bus.key empty with --fmu")
        check_settings(config)
        if self.c is not None:
            check_offset(config)

    def write(self, library: Path, release: Bundle, config: Config) -> None:
        """Write the FMU and the image from a C library, if they were requested."""
        if self.fmu is not None:
            write_fmu(self.fmu, library, release, config)
        if self.image is not None:
            write_image(self.image, library, release, config, self.key)

    def write_for_testers(self, release: Bundle, config: Config) -> None:
        """Write the descriptions of the ECU, if requested."""
        if self.for_testers is not None:
            found = descriptions(release, config)
            write_files(self.for_testers, found)
            console.print(f"wrote {self.for_testers}: {', '.join(found)} of {release.manifest.name}")

    def print(self) -> None:
        """Print the size and the signer of the image, and the kind of the FMU."""
        if self.image is not None:
            console.print(f"wrote {self.image}: {self.image.stat().st_size / 1024:.1f} KiB, {self.signed}")
        if self.fmu is not None:
            kind, path = self.fmu
            machines = "this machine and Windows" if kind.windows else "this machine"
            console.print(f"wrote {path}: {kind.words}, compiled for {machines}, with its sources")

    @property
    def signed(self) -> str:
        """The image's signer in words."""
        return "unsigned" if self.key is None else f"signed by key {public_key(self.key).fingerprint}"


def _export_model(
    model: Path,
    output: Path,
    files: _Files,
    config: Config,
    dataset: Path | None,
    *,
    name: str | None,
    precision: str | None,
    estimator: bool,
) -> None:
    from export.program.controller_program import program_of
    from export.release.pipeline import EXPORT_PHASES, export_all
    from export.release.sbom import release_bom, write_bom

    used = recording() if dataset is None else dataset
    with TemporaryDirectory() as scratch, phases("export", EXPORT_PHASES) as (report, phase):
        folder = files.c or Path(scratch, "library")
        made = None
        if estimator:
            program = program_of(model_folder.read(model), config.mpc)
            made = fitted_estimator(used, program.sensors, program.window, report)
        done, release = export_all(
            model,
            output,
            name="truck-wake" if name is None else name,
            recording=used,
            config=config,
            created=date.today(),
            precision="int8" if precision is None else precision,
            library=c_library(folder, config, console.print) if files.in_c else None,
            key=files.key,
            named=dataset is not None,
            estimator=made,
            notice=console.print,
            phase=phase,
        )
        bill = write_bom(output, release_bom(release, read_files(output)))
        files.write(folder, release, config)
    _print_checks(done)
    size = f"controller.onnx {done.graph.controller_bytes / 1024:.0f} KiB"
    console.print(f"wrote {output}: {done.lowered.precision}, {size}, {files.signed}")
    console.print(f"wrote {bill}: bill of materials, CycloneDX 1.6")
    point, count = config.operating_point, len(done.lowered.effective.sensors)
    console.print(
        f"for a body {point.width:g} m wide at {point.speed:g} m/s, a control period of {config.period_ns / 1e6:g} ms: "
        f"change them with --set operating_point.width and operating_point.speed"
    )
    if count != SENSORS:
        console.print(
            f"the model has {count} sensors, but this ECU needs the {SENSORS} of Pressure (train.sensors={SENSORS}); "
            f"the control step in C and the ONNX graph work with any number"
        )
    if done.library is not None and files.c is not None:
        workspace = f"{done.library.workspace_bytes / 1024:.0f} KiB of workspace"
        console.print(f"wrote {files.c}: C99, {done.lowered.precision}, {workspace}")
    files.print()
    files.write_for_testers(release, config)


def _export_shipped(files: _Files, given: list[str]) -> None:
    config = settings("export --c", given, uses=USES_IN_C).config
    files.check_in_c(config)

    from export.release.pipeline import EXPORT_PHASES

    release = open_release(None)
    with TemporaryDirectory() as scratch, phases("export", EXPORT_PHASES) as (_, phase):
        folder = files.c or Path(scratch, "library")
        done = write_shipped_library(folder, release, config, billed=True, notice=console.print, phase=phase)
        files.write(folder, release, config)
    _print_checks(done)
    if files.c is not None:
        console.print(f"wrote {files.c}: C99, {release.manifest.name}")
    files.print()
    files.write_for_testers(release, config)


def _print_checks(done: "Gated") -> None:
    from export.release.pipeline import gate_figures

    figures = gate_figures(done)
    rows = ((title, f"{value:.3g}" if isinstance(value, float) else str(value)) for title, value in figures)
    print_table("check", "measured", rows=rows)


def _settings(model: Path, given: list[str], *, uses: Sequence[str] = USES) -> Config:
    try:
        own = model_folder.read_description(model)["config"]
    except ModelError:
        # As in every command, a setting that does not exist is reported before all other errors.
        read_settings(given)
        raise
    try:
        base = from_tree(own)
    except ConfigError as error:
        raise ModelError(f"model {model}: {model_folder.DESCRIPTION}: {error}") from error
    return settings("export", given, uses=uses, base=base).config


def _description(bundle: Path) -> str:
    try:
        there = bundles.load(bundle)
    except StillwakeError:
        return "holds other files already"
    if there.signer is None:
        return f"holds the bundle {there.manifest.name} already, unsigned"
    return f"holds the bundle {there.manifest.name} already, signed by key {there.signer.fingerprint}"


def mcu(
    library: Annotated[
        Path | None, typer.Argument(help="Folder written by `export --c`; default: the shipped bundle's library.")
    ] = None,
    json_file: shared.JsonFile = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Compile the C library for a Cortex-M7, replay the library's recorded rows on an emulated Cortex-M7, and compare
    the results with this computer's results.

    The last lines report whether a control step fits into the control period of the operating point.
    """
    config = settings("mcu", given, uses=["operating_point", "flow.control_period"]).config
    check_json(json_file)

    from firmware_sim.mcu.measure import MCU_PHASES, measure, verdicts

    with phases("Cortex-M7", MCU_PHASES) as (_, phase), library_folder(library) as folder:
        measured = measure(read_sources(folder), read_recorded(folder), phase=phase)
    rows = (*measured.rows(), *verdicts(measured.modelled_ms, config.period_ns / 1e6))
    print_table("one control step on a Cortex-M7", "", rows=rows)
    facts = {"library": "shipped" if library is None else str(library), "period_ms": config.period_ns / 1e6}
    save_json(json_file, figures=asdict(measured), facts=facts)
