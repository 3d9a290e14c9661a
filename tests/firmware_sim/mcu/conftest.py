"""A board with the loader, and the flash of one that a tester flashed over CAN."""

from pathlib import Path

import pytest

from firmware_sim.mcu.board.board_ecu import BoardEcu
from tests.can_bridge.flashing.releases import keys
from tests.conftest import shared
from tests.firmware_sim.mcu.board_node import QUICK, BoardLine, Built


@pytest.fixture(scope="session")
def built(release) -> Built:
    return Built(release)


@pytest.fixture(scope="session")
def fresh(built) -> BoardEcu:
    return built.ecu(times=QUICK)


@pytest.fixture(scope="session")
def provisioned(built, fresh, tmp_path_factory) -> bytes:
    def provision(folder: Path) -> None:
        board = built.ecu(firmware=fresh.firmware, times=QUICK)
        BoardLine(board).provision(keys(), built.image("one"))
        (folder / "bank").write_bytes(board.board.flash.bank.pack())

    return (shared(tmp_path_factory, "provisioned", provision) / "bank").read_bytes()
