"""The page of a fresh board, from its keys to the confirmed release, by its commands and over a real bus."""

import re
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from can_bridge.secoc.key import read_secret
from contract.config.vehicle import BusConfig
from contract.release import controller_image as images
from contract.release.signing import read_private_key, read_public_key
from ecu.in_c.c_ecu import ecu_sources
from ecu.in_c.c_image import controller_image, read_packed
from tests.ecu.in_c.exported import CONFIG, exported

BUS = ("--bus", "udp_multicast:239.74.163.41")
PAGE = Path(__file__).resolve().parents[2] / "docs/how-to/board-and-rtos.md"
COMMAND = (sys.executable, "-m", "stillwake")


def bytes_by_hand(folder: Path) -> list[list[int]]:
    """What the page's lines print for the header of equipment."""
    lines = re.findall(r"^    ((?:openssl pkey|sed|tail) .*)$", PAGE.read_text(), re.MULTILINE)
    printed = [
        subprocess.run(["sh", "-ec", line], cwd=folder, capture_output=True, text=True, check=True) for line in lines
    ]
    return [[int(one, 16) for one in re.findall("0x(..)", done.stdout)] for done in printed]


@pytest.mark.processes
@pytest.mark.mcu
@pytest.mark.proofs  # a firmware is built, and ten processes start
@pytest.mark.parametrize("frames", ["fd", "classic"])
def test_the_page_leads_from_a_fresh_board_to_a_flashed_controller(frames, tmp_path):
    """With a small release in place of the shipped one, by both kinds of frames; the second board has the flash that
    the first one left."""
    for module in ("unicorn", "capstone", "elftools", "ziglang", "udsoncan"):
        pytest.importorskip(module, reason=f"{module} is not installed")
    release, config = exported(tmp_path), replace(CONFIG, bus=BusConfig(frames=frames))
    bus = (*BUS, *(() if frames == "fd" else ("--set", "bus.frames=classic")))
    access = ("--access", "access.key")

    def stillwake(*words: str, status: int = 0) -> str:
        done = subprocess.run([*COMMAND, *words], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == status, done.stdout + done.stderr
        return done.stdout + done.stderr

    def with_board(lines: Sequence[Sequence[str]]) -> list[str]:
        files = ("--mcu", "flash.bin", "--library", str(release.folder), "--root", "root/release.pub")
        board = ("ecu", str(release.bundle_path), *files)
        log = tmp_path / "board.log"
        with (
            log.open("w") as file,
            subprocess.Popen([*COMMAND, *board, *access, *bus], cwd=tmp_path, stdout=file, stderr=file) as ecu,
        ):
            try:
                until = time.monotonic() + 300.0
                while "running" not in log.read_text():
                    assert ecu.poll() is None and time.monotonic() < until, log.read_text()
                    time.sleep(0.2)
                return [stillwake(*line, *bus, *access) for line in lines]
            finally:
                ecu.terminate()

    stillwake("keygen", "root")
    stillwake("keygen", "maker")
    keys = ("--key", "root/release.key", "--allow", "maker/release.pub")
    stillwake("bundle", "keylist", "keys.list", "--version", "1", *keys)
    stillwake("keygen", "--secret", "access.key")
    files = ecu_sources(release.folder, release.bundle, config) | read_packed(release.folder)
    key = read_private_key(tmp_path / "maker/release.key")
    (tmp_path / "release.swi").write_bytes(controller_image(files, release.bundle, config, key))
    if shutil.which("openssl"):
        vehicle = images.read((tmp_path / "release.swi").read_bytes()).facts.vehicle
        root, secret = read_public_key(tmp_path / "root/release.pub"), read_secret(tmp_path / "access.key")
        assert bytes_by_hand(tmp_path) == [list(root.raw), list(secret), list(vehicle)]
    (flashed,) = with_board([("flash", "release.swi", "--keys", "keys.list")])
    assert "key list 1, and had none" in flashed
    assert "runs no release" in flashed and "runs, and is confirmed" in flashed
    (again,) = with_board([("flash", "release.swi")])
    assert "already runs" in again
