"""FMUs of an ECU in C."""

from collections.abc import Callable
from pathlib import Path

import pytest

from contract.config.tree import Config
from ecu.in_c.c_ecu import ecu_sources
from firmware_sim.fmu.fmu_files import ecu_fmu
from firmware_sim.fmu.kinds import FmuKind
from tests.ecu.in_c.exported import CONFIG


@pytest.fixture(scope="module")
def fmu_of(release, tmp_path_factory) -> Callable[..., tuple[Path, dict[str, bytes]]]:
    """(FMU, the ECU's sources) of a configuration and a kind."""

    def made(config: Config = CONFIG, **kinds: bool) -> tuple[Path, dict[str, bytes]]:
        kind, path = FmuKind(**kinds), tmp_path_factory.mktemp("fmu") / "ecu.fmu"
        sources = ecu_sources(release.folder, release.bundle, config)
        path.write_bytes(ecu_fmu(sources, release.bundle, config, kind))
        return path, sources

    return made
