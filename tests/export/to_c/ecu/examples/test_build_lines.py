"""The lines in the examples' heads, run as a stranger would."""

import re
import shutil
import subprocess
import sys

import pytest

from contract.controller.c_folder import write_folder
from firmware_sim.in_c.compiler import zig_compiler


@pytest.mark.compiler
@pytest.mark.slow  # builds the folder as a stranger would
@pytest.mark.parametrize("by_cmake", [False, pytest.param(True, marks=pytest.mark.proofs)])
def test_the_lines_in_their_heads_and_cmake_build_them(exported, built_for, by_cmake, tmp_path):
    config, _ = built_for
    if config.bus.frames != "fd":
        pytest.skip("one of the sets shows it")
    write_folder(tmp_path / "c", exported)
    heads = [exported[f"examples/{name}.c"].decode().split("*/")[0] for name in ("main_socketcan", "systick")]
    lines = [re.sub(r"\\\n \*", "", head) for head in heads]
    builds = [re.findall(r"^ \*     (.*-o \S+)$", text, flags=re.MULTILINE) for text in lines]
    assert [len(found) for found in builds] == [1, 1]
    commands = ["cmake -B build && cmake --build build"] if by_cmake else [builds[0][0]]
    if by_cmake and shutil.which("cmake") is None:
        pytest.skip("cmake is not installed")
    if zig_compiler() is not None and not by_cmake:
        commands.append(builds[1][0].replace("python", sys.executable, 1))
    for command in commands:
        done = subprocess.run(command, shell=True, cwd=tmp_path / "c", capture_output=True, text=True, check=False)
        assert (done.returncode, "warning" in done.stderr) == (0, False), done.stderr
