"""The ECU in C for the folder of a C library, and that folder for the shipped bundle."""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from contract.config.loading import load_config
from contract.config.tree import Config
from contract.controller.c_folder import ECU_SETTINGS
from contract.errors import StillwakeError
from contract.release.bundle import Bundle, load
from stillwake.releases import open_release
from stillwake.shipped import BUNDLE
from wake.shipped import model, recording

if TYPE_CHECKING:
    from export.release.gated import Gated


def ecu_files(bundle: Path, *, config: Config, notice: Callable[[str], None]) -> dict[str, bytes]:
    """The ECU for a release, or nothing where C cannot have it.

    Args:
        bundle: just written.
        config: of the vehicle.
        notice: called with a line for what the ECU does without, or for why there is none.
    """
    from export.to_c.library import ecu_sources
    from firmware_sim.ecu.c_settings import ecu_settings

    try:
        release = load(bundle)
        return ecu_sources() | {ECU_SETTINGS: ecu_settings(release, _without_check(release, config, notice))}
    except StillwakeError as error:
        notice(f"no ECU in C, the library has the control step alone: {error}")
        return {}


def write_shipped_library(
    folder: Path,
    release: Bundle,
    config: Config,
    *,
    notice: Callable[[str], None] = lambda line: None,
    phase: Callable[[str], None] = lambda name: None,
) -> "Gated":
    """The C library and ECU of the shipped bundle, made from the shipped model and checked to be the same program.

    Args:
        folder: to write.
        release: the shipped bundle.
        config: of the vehicle.
        notice, phase: as `ecu_files` and `export.release.pipeline.export_library` have them.

    Raises:
        ExportError: model and bundle do not belong together.
        StillwakeError: the data are not installed, or the folder cannot be written.
    """
    from export.release.pipeline import export_library

    return export_library(
        model(),
        release,
        folder,
        recording=recording(),
        ecu=lambda: ecu_files(BUNDLE, config=config, notice=notice),
        phase=phase,
    )


@contextmanager
def library_folder(given: Path | None) -> Iterator[Path]:
    """The folder that was given, or one with the shipped bundle's library that lasts as long as the block."""
    if given is not None:
        yield given
        return
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch, "library")
        write_shipped_library(folder, open_release(None, None), load_config())
        yield folder


def _without_check(release: Bundle, config: Config, notice: Callable[[str], None]) -> Config:
    """The settings, without the check of the sensors for a release that has no estimator; as the ECU in Python."""
    check = config.ecu.sensor_check
    if release.manifest.sensor_estimator is not None or not check.enabled:
        return config
    notice("the ECU in C does not check the sensors: the release has no estimator (--sensors)")
    return replace(config, ecu=replace(config.ecu, sensor_check=replace(check, enabled=False)))
