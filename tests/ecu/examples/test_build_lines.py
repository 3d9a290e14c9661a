"""The lines in the examples' heads and on the page of them, run as a stranger would."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from contract.controller.c_folder import write_folder

PAGE = Path(__file__).resolve().parents[3] / "docs" / "how-to" / "integrate-the-ecu.md"


@pytest.mark.proofs  # three builds as a stranger's; test_rtos.py and test_socketcan.py build the same sources
@pytest.mark.compiler
def test_the_lines_in_their_heads_build_them(exported, tmp_path):
    write_folder(tmp_path / "c", exported)
    heads = [exported[f"examples/{name}.c"].decode().split("*/")[0] for name in ("main_socketcan", "systick")]
    lines = [re.sub(r"\\\n \*", "", head) for head in heads]
    builds = [re.findall(r"^ \*     (.*-o \S+)$", text, flags=re.MULTILINE) for text in lines]
    assert [len(found) for found in builds] == [1, 1]
    commands = [builds[0][0], builds[1][0].replace("python", sys.executable, 1)]
    if shutil.which("arm-none-eabi-gcc"):
        (line,) = re.findall(r"`(arm-none-eabi-gcc[^`]*systick\.c[^`]*)`", PAGE.read_text())
        commands.append(line.replace("\n", " "))
    for command in commands:
        done = subprocess.run(command, shell=True, cwd=tmp_path / "c", capture_output=True, text=True, check=False)
        assert (done.returncode, "warning" in done.stderr) == (0, False), done.stderr
