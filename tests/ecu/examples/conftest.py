"""The folder of a random release with its examples, for CAN FD or, with `both_sets`, either set of messages."""

from pathlib import Path

import numpy as np
import pytest

from can_bridge.wire.message_sets import MessageSet, message_set
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.config.tree import Config
from contract.config.vehicle import BusConfig, EcuConfig, SensorCheckConfig
from contract.controller.c_folder import BOARD
from contract.controller.image_payload import with_layout
from contract.release.bundle import load
from ecu.c.sources import example_sources, firmware_sources
from ecu.in_c.c_examples import PLAYED, played_pressures
from ecu.in_c.c_settings import HEADER, ecu_settings
from examples.random_programs import random_program
from export.program.controller_program import random_windows
from export.to_c.library import documents, int8_library

START = ("sw_board_start.h", "sw_board_start.c", "sw_board_libc.c")
"""What the bare core starts with; a program with an operating system has its own."""

MODEL = ModelConfig(latent=3, lstm_width=8, dynamics_width=16, decoder_width=8)
"""Of the random release."""


def without(folder: dict[str, bytes], *names: str) -> dict[str, bytes]:
    return {name: text for name, text in folder.items() if name not in names}


both_sets = pytest.mark.parametrize("built_for", ["fd", "classic"], indirect=True)


@pytest.fixture(scope="session", params=["fd"])
def built_for(request) -> tuple[Config, MessageSet]:
    ecu = EcuConfig(sensor_check=SensorCheckConfig(enabled=False))  # the random release has no estimator
    config = Config(bus=BusConfig(frames=request.param), ecu=ecu)
    return config, message_set(config.bus)


@pytest.fixture(scope="session")
def exported(built_for, random_release) -> dict[str, bytes]:
    """The files that `export --c` writes, but for recorded rows."""
    config, _ = built_for
    program = random_program(1, model=MODEL, mpc=MpcConfig(horizon=8))
    windows = random_windows(program, 20)
    library = int8_library(program, windows) | firmware_sources() | {HEADER: ecu_settings(load(random_release), config)}
    played = {PLAYED: played_pressures(np.concatenate(windows), config)}
    return with_layout(library) | example_sources() | played | documents(library)


@pytest.fixture(scope="session")
def folder(exported) -> dict[str, bytes]:
    """The same flat and without documents: the tests' compiler takes no folders in folders."""
    names = [name for name in exported if name.endswith((".c", ".h", ".ld")) and name.split("/")[0] not in BOARD]
    taken = {name: exported[name] for name in (*names, *(f"board/{name}" for name in START))}
    return without({Path(name).name: text for name, text in taken.items()}, "replay.c")
