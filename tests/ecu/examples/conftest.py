"""The library of a random release with its examples, for CAN FD or, with `both_sets`, either set of messages."""

from pathlib import Path

import numpy as np
import pytest

from can_bridge.wire.message_sets import MessageSet, message_set
from contract.config.tree import Config
from contract.config.vehicle import BusConfig, EcuConfig, SensorCheckConfig
from contract.controller.c_folder import BOARD
from ecu.c.sources import example_sources
from ecu.in_c.c_ecu import ecu_sources
from ecu.in_c.c_examples import MOST_PERIODS, PLAYED, played_pressures

START = ("sw_board_start.h", "sw_board_start.c", "sw_board_libc.c")
"""What the bare core starts with; a program with an operating system has its own."""


def without(folder: dict[str, bytes], *names: str) -> dict[str, bytes]:
    return {name: text for name, text in folder.items() if name not in names}


both_sets = pytest.mark.parametrize("built_for", ["fd", "classic"], indirect=True)


@pytest.fixture(scope="session", params=["fd"])
def built_for(request) -> tuple[Config, MessageSet]:
    ecu = EcuConfig(sensor_check=SensorCheckConfig(enabled=False))  # the random release has no estimator
    bus = BusConfig(key="bus.key") if request.param == "secured" else BusConfig(frames=request.param)
    config = Config(bus=bus, ecu=ecu)
    return config, message_set(config.bus)


@pytest.fixture(scope="session")
def exported(built_for, release) -> dict[str, bytes]:
    """Sources and examples that `export --c` writes, with random rows in place of recorded ones."""
    config, _ = built_for
    rows = np.random.default_rng(0).normal(scale=0.3, size=(MOST_PERIODS, 5))
    library = ecu_sources(release.folder, release.bundle, config)
    return library | example_sources() | {PLAYED: played_pressures(rows, config)}


@pytest.fixture(scope="session")
def folder(exported) -> dict[str, bytes]:
    """The same flat: the tests' compiler takes no folders in folders."""
    names = [name for name in exported if name.endswith((".c", ".h", ".ld")) and name.split("/")[0] not in BOARD]
    taken = {name: exported[name] for name in (*names, *(f"board/{name}" for name in START))}
    return without({Path(name).name: text for name, text in taken.items()}, "replay.c")
