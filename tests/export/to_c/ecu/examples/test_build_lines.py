"""The lines in the examples' heads, run as a stranger would."""

import re
import subprocess
import sys

import pytest

from contract.controller.c_folder import write_folder


@pytest.mark.compiler
@pytest.mark.slow  # builds the folder as a stranger would
def test_the_lines_in_their_heads_build_them(exported, built_for, tmp_path):
    config, _ = built_for
    if config.bus.frames != "fd":
        pytest.skip("one of the sets shows it")
    write_folder(tmp_path / "c", exported)
    heads = [exported[f"examples/{name}.c"].decode().split("*/")[0] for name in ("main_socketcan", "systick")]
    lines = [re.sub(r"\\\n \*", "", head) for head in heads]
    builds = [re.findall(r"^ \*     (.*-o \S+)$", text, flags=re.MULTILINE) for text in lines]
    assert [len(found) for found in builds] == [1, 1]
    for command in (builds[0][0], builds[1][0].replace("python", sys.executable, 1)):
        done = subprocess.run(command, shell=True, cwd=tmp_path / "c", capture_output=True, text=True, check=False)
        assert (done.returncode, "warning" in done.stderr) == (0, False), done.stderr
