"""Calls of `stillwake` commands, as a user would type them, as steps of a longer measurement."""

import subprocess
import sys
from pathlib import Path
from typing import Final

from contract.errors import StillwakeError

ROOT: Final = Path(__file__).resolve().parents[2]

LOOP: Final = ("Cd_controlled", "reduction_percent", "abs_Cl_controlled", "mean_Cl_controlled", "rms_action")
"""Figures of `stillwake run --json` for the comparison of controllers."""


def stillwake(*arguments: object) -> None:
    """Run one command of this source tree, whose messages go to the terminal. Raises StillwakeError if it fails."""
    words = [str(argument) for argument in arguments]
    with subprocess.Popen([sys.executable, "-m", "stillwake", *words]) as process:
        try:
            status = process.wait()
        except BaseException:
            # The command has to delete its own temporary files, so a stop that reached only this process is passed on.
            process.terminate()
            process.wait()
            raise
    if status != 0:
        raise StillwakeError(f"stillwake {' '.join(words)}: ended with status {status}")
