"""The tester's side lies in the base install, and asks for its extra only where it is used."""

import subprocess
import sys
from pathlib import Path

import can_bridge.tester

WITH_THE_EXTRA = ("__init__", "transport", "direct_connection")
"""Kinds of udsoncan's connection."""


def test_all_but_the_connections_imports_without_the_extra() -> None:
    names = sorted(path.stem for path in Path(can_bridge.tester.__file__).parent.glob("*.py"))
    code = "import sys; sys.modules.update(udsoncan=None, isotp=None)\n"
    code += "".join(f"import can_bridge.tester.{name}\n" for name in names if name not in WITH_THE_EXTRA)
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, "")
