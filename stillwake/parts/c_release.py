"""The functions that write the folder of a C library with its ECU, the library's FMU and image, and the descriptions of
an ECU for other tools."""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.arrays import Array
from contract.atomic import replacing
from contract.config.loading import load_config
from contract.config.tree import Config
from contract.controller.c_folder import ECU_SETTINGS, read_sources
from contract.controller.estimator import ESTIMATOR
from contract.errors import LibraryError, StillwakeError
from contract.release.checks import Bundle, dbc_bytes
from contract.release.controller_image import FORMATS
from contract.shipped import model, recording
from stillwake.parts.releases import open_release

if TYPE_CHECKING:
    from export.release.gated import Gated
    from export.release.pipeline import CLibrary
    from firmware_sim.fmu.kinds import FmuKind

A2L: Final = "stillwake.a2l"


def ecu_files(release: Bundle, rows: Array, *, config: Config, notice: Callable[[str], None]) -> dict[str, bytes]:
    """Return the files of the ECU in C for a release, by name, with examples and descriptions; empty if the ECU in C
    cannot run the release. An example program replays the pressures in `rows`, recorded pressures of S sensors and
    action in n control periods, (n, S + 1). `notice` is called with a line for each part that the ECU lacks, or with
    the reason why there is no ECU."""
    from ecu.c.sources import example_sources, firmware_sources
    from ecu.in_c import uds_settings
    from ecu.in_c.c_examples import PLAYED, played_pressures
    from ecu.in_c.c_settings import ecu_settings
    from export.to_c.estimator import estimator_files

    try:
        used = _without_check(release, config, notice)
        sources = firmware_sources() | example_sources() | {ECU_SETTINGS: ecu_settings(release, used)}
        sources |= estimator_files(release.files[ESTIMATOR]) if used.ecu.sensor_check.enabled else {}
        sources[f"loader/{uds_settings.UDS_SETTINGS}"] = uds_settings.uds_settings()
        return sources | {PLAYED: played_pressures(rows, used)} | descriptions(release, used)
    except StillwakeError as error:
        notice(f"no ECU in C; the library has only the control step: {error}")
        return {}


def descriptions(release: Bundle, config: Config) -> dict[str, bytes]:
    """Return the descriptions of a release's ECU for other tools, by the names of their files: its messages, its
    calibration and its diagnosis. Raises BundleError if the release is for another vehicle."""
    from can_bridge.calibration.a2l import a2l_text
    from can_bridge.calibration.segment import Segment
    from can_bridge.odx.pdx import SEED_AND_KEY, pdx, seed_and_key
    from ecu.calibrating import limits_of, release_calibration
    from ecu.fit import check_vehicle
    from firmware_sim.runs.reasons import BECAUSE

    check_vehicle(release, config)
    segment = Segment(release_calibration(release, config), limits_of(release, config))
    a2l = a2l_text(segment, release=release.manifest.name, bus=config.bus, period_ns=config.period_ns)
    others = {"stillwake.pdx": pdx(config.bus, BECAUSE), SEED_AND_KEY: seed_and_key()}
    return {"stillwake.dbc": dbc_bytes(), A2L: a2l.encode()} | others


def c_library(folder: Path, config: Config, notice: Callable[[str], None], *, billed: bool = True) -> "CLibrary":
    """Return the C library that an export writes into a folder, with the ECU of its release. With `billed`, the folder
    also gets a bill of materials. `notice` is as in `ecu_files`."""
    from ecu.in_c.host_library import CController
    from export.release.pipeline import CLibrary
    from export.release.sbom import folder_bom

    ecu = partial(ecu_files, config=config, notice=notice)
    return CLibrary(folder=folder, compiled=CController, ecu=ecu, bill=folder_bom if billed else None)


def write_shipped_library(
    folder: Path,
    release: Bundle,
    config: Config,
    *,
    billed: bool = False,
    notice: Callable[[str], None] = lambda line: None,
    phase: Callable[[str], None] = lambda name: None,
) -> "Gated":
    """Write the C library and the ECU of the shipped bundle, made from the shipped model. The library's program must
    equal the bundle's program. `billed` and `notice` are as in `c_library`, and `phase` is as in
    `export.release.pipeline`. Raises BundleError or ConfigError, before the work, if the ECU in C does not support the
    bundle or these settings; ExportError if model and bundle do not belong together; StillwakeError if the data are not
    installed, or the folder cannot be written."""
    from ecu.in_c.c_settings import ecu_settings
    from export.release.pipeline import export_library

    ecu_settings(release, _without_check(release, config, lambda line: None))
    library = c_library(folder, config, notice, billed=billed)
    return export_library(model(), release, library, recording=recording(), phase=phase)


def write_fmu(fmu: "tuple[FmuKind, Path]", library: Path, release: Bundle, config: Config) -> None:
    """Write the ECU of a C library, which was made from `release`, as an FMU; `fmu` is the kind and the file. The
    settings of the vehicle are compiled in. Raises ConfigError if the kind does not support them; LibraryError if the
    library has only the control step, or does not compile; StillwakeError if the file cannot be written."""
    from firmware_sim.fmu.fmu_files import ecu_fmu

    (kind, path), sources = fmu, read_sources(library)
    if ECU_SETTINGS not in sources:
        raise LibraryError(f"{path}: not written: there is no ECU in C for this release and these settings")
    made = ecu_fmu(sources, release, config, kind)
    with replacing(path) as temporary:
        temporary.write_bytes(made)


def write_image(
    path: Path, library: Path, release: Bundle, config: Config, key: Ed25519PrivateKey | None = None
) -> None:
    """Write the release of a C library as an image, signed if a key is given. The ending of the file's name states the
    format (`FORMATS`). The other arguments and the errors are as for `write_fmu`."""
    from ecu.in_c.c_image import controller_image, read_packed

    made = controller_image(read_sources(library) | read_packed(library), release, config, key)
    with replacing(path) as temporary:
        temporary.write_bytes(FORMATS[path.suffix.lower()](made))


@contextmanager
def library_folder(given: Path | None) -> Iterator[Path]:
    """Yield the given folder, or a temporary folder with the shipped bundle's library, which is deleted at the end."""
    if given is not None:
        yield given
        return
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch, "library")
        write_shipped_library(folder, open_release(None), load_config())
        yield folder


def _without_check(release: Bundle, config: Config, notice: Callable[[str], None]) -> Config:
    """Return the settings, without the sensor check if the ECU in C cannot run it. Without an estimator in the release,
    the ECU in Python cannot run the check either."""
    check, manifest = config.ecu.sensor_check, release.manifest
    has_estimator = manifest.sensor_estimator is not None
    if not check.enabled or (has_estimator and manifest.precision == "int8"):
        return config
    of_precision = "its estimator needs the integer products of an int8 library (--precision int8)"
    why = of_precision if has_estimator else "the release has no estimator (--estimator)"
    notice(f"the ECU in C does not check the sensors: {why}")
    return replace(config, ecu=replace(config.ecu, sensor_check=replace(check, enabled=False)))
