"""The pages that lead through flashing and calibration, of an ECU and of a fresh board, are followed line by line."""

import os
import re
import shlex
import shutil
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Final

import pytest

from can_bridge.secoc.key import read_secret
from contract.config.vehicle import BusConfig
from contract.release import controller_image as images
from contract.release.signing import read_private_key, read_public_key
from ecu.in_c.c_ecu import ecu_sources
from ecu.in_c.c_image import controller_image, read_packed
from tests.conftest import STILLWAKE
from tests.ecu.in_c.exported import CONFIG, exported

ROOT: Final = Path(__file__).resolve().parents[2]
GROUP: Final = f"239.78.{os.getpid() >> 8 & 0xFF}.{os.getpid() & 0xFF}"
BUS: Final = ("--bus", "udp_multicast:239.74.163.41")
PAGE: Final = ROOT / "docs/how-to/board-and-rtos.md"


def lines_of(page: str, heading: str = "") -> list[list[str]]:
    """The calls of `stillwake` in the indented blocks of a page or of one of its sections, on this test's bus."""
    text = (ROOT / page).read_text(encoding="utf-8")
    if heading:
        text = text.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    text = text.replace("\\\n", " ").replace("interface=socketcan", "interface=udp_multicast")
    text = text.replace("channel=can0", f"channel={GROUP}").replace("socketcan:can0", f"udp_multicast:{GROUP}")
    text = text.replace("239.74.163.2", GROUP)
    return [shlex.split(line, comments=True)[1:] for line in re.findall(r"^    (stillwake .*)$", text, re.MULTILINE)]


@contextmanager
def ecu(arguments: Sequence[str], place: Path, words: str) -> Iterator[None]:
    """The page's other terminal, once the ECU says these words."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(ROOT), os.environ.get("PYTHONPATH", "")))}
    command, log, until = [*STILLWAKE, *arguments], place / "ecu.log", time.monotonic() + 300.0
    with (
        log.open("w") as file,
        subprocess.Popen(command, cwd=place, env=environment, stdout=file, stderr=file) as popen,
    ):
        try:
            while words not in log.read_text():
                assert popen.poll() is None and time.monotonic() < until, log.read_text()
                time.sleep(0.1)
            yield
        finally:
            popen.terminate()


def follow(cli, lines: list[list[str]]) -> list[str]:
    """Call them in their order; the ECU runs from its line on. What each of the others printed."""
    outputs: list[str] = []
    for number, line in enumerate(lines):
        if line[:2] == ["ecu", "--slots"]:
            with ecu(line, Path.cwd(), "runs ECU"):
                return outputs + follow(cli, lines[number + 1 :])
        outcome = cli(*line)
        assert outcome.code == 0, f"{shlex.join(line)}: {outcome.err}"
        outputs.append(outcome.out)
    return outputs


@pytest.fixture
def checkout(tmp_path, monkeypatch) -> None:
    """A folder with what the pages take from a checkout."""
    for name in ("contract", "firmware_sim"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)


@pytest.mark.proofs  # the page of flashing stays
@pytest.mark.processes
@pytest.mark.usefixtures("checkout")
def test_the_tour_flashes_and_calibrates_and_so_does_the_page_of_calibration(cli):
    lines = lines_of("docs/tutorial/tour.md", "Flash and calibrate it")
    calibrated = lines_of("docs/how-to/calibrate.md")
    assert (len(lines), len(calibrated)) == (8, 5)
    *_, flashed, _, told, _, _, stored, reverted, _ = follow(cli, lines + calibrated)
    assert "runs, and is confirmed" in flashed
    assert re.search(r"slot A\W+confirmed, ", told)
    assert "a calibration is stored" in stored
    assert "nothing is stored" in reverted


@pytest.mark.processes
@pytest.mark.usefixtures("checkout")
def test_the_page_of_flashing_leads_from_the_first_key_to_the_revocation_of_one(cli):
    flashed, _, brought = follow(cli, lines_of("docs/how-to/flash-an-ecu.md"))[-3:]
    assert "mine-2 runs, and is confirmed" in flashed
    assert brought.strip() == "the ECU has key list 3, and had 2"


def bytes_by_hand(folder: Path) -> list[list[int]]:
    """What the page's lines print for the header of equipment."""
    lines = re.findall(r"^    ((?:openssl pkey|sed|tail) .*)$", PAGE.read_text(), re.MULTILINE)
    ran = [subprocess.run(["sh", "-ec", one], cwd=folder, capture_output=True, text=True, check=True) for one in lines]
    return [[int(one, 16) for one in re.findall("0x(..)", done.stdout)] for done in ran]


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
        done = subprocess.run([*STILLWAKE, *words], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == status, done.stdout + done.stderr
        return done.stdout + done.stderr

    def with_board(lines: Sequence[Sequence[str]]) -> list[str]:
        files = ("--mcu", "flash.bin", "--library", str(release.folder), "--root", "root/release.pub")
        board = ("ecu", str(release.bundle_path), *files)
        with ecu((*board, *access, *bus), tmp_path, "running"):
            return [stillwake(*line, *bus, *access) for line in lines]

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
