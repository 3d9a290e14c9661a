"""The tester's side lies in the base install, and asks for its extra only where it is used."""

import subprocess
import sys
from pathlib import Path

import can_bridge.tester

ROOM = Path(can_bridge.tester.__file__).parent
WITH_THE_EXTRA = ("transport", "direct_connection")
"""Kinds of udsoncan's connection."""


def test_all_but_the_connections_imports_without_the_extra() -> None:
    names = sorted(path.stem for path in ROOM.glob("*.py") if path.stem not in ("__init__", *WITH_THE_EXTRA))
    assert "sequence" in names
    code = "import sys; sys.modules.update(udsoncan=None, isotp=None)\n"
    code += "".join(f"import can_bridge.tester.{name}\n" for name in names)
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert found.stderr == ""
    assert found.returncode == 0
