"""The pages that lead through flashing and calibration can be followed line by line."""

import os
import re
import shlex
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pytest

from tests.conftest import STILLWAKE
from tests.ecu.daemon.driving import PATIENCE_S

ROOT: Final = Path(__file__).resolve().parents[2]
GROUP: Final = f"239.78.{os.getpid() >> 8 & 0xFF}.{os.getpid() & 0xFF}"


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
def ecu(arguments: list[str]) -> Iterator[None]:
    """The page's other terminal, once the ECU runs."""
    path = os.pathsep.join((str(ROOT), os.environ.get("PYTHONPATH", "")))
    command = [*STILLWAKE, *arguments]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": path}) as popen:
        assert popen.stderr is not None
        said = popen.stderr
        runs = threading.Event()

        def listen() -> None:
            for line in said:
                if "runs ECU" in line:
                    runs.set()

        listener = threading.Thread(target=listen)
        listener.start()
        try:
            assert runs.wait(PATIENCE_S)
            yield
        finally:
            popen.kill()
            listener.join(PATIENCE_S)


def follow(cli, lines: list[list[str]]) -> list[str]:
    """Call them in their order; the ECU runs from its line on. What each of the others printed."""
    outputs: list[str] = []
    for number, line in enumerate(lines):
        if line[:2] == ["ecu", "--slots"]:
            with ecu(line):
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
