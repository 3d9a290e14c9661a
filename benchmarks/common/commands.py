"""Calls of `stillwake` commands as steps of a longer measurement, with the arguments that a user would type."""

import subprocess
import sys
from pathlib import Path
from typing import Final

from contract.errors import StillwakeError

ROOT: Final = Path(__file__).resolve().parents[2]

LOOP: Final = ("Cd_controlled", "reduction_percent", "abs_Cl_controlled", "mean_Cl_controlled", "rms_action")
"""Figures of `stillwake run --json` by which controllers are compared."""


def stillwake(*arguments: object) -> None:
    """Run one command of this source tree, which writes its messages to the terminal. Raises StillwakeError if the
    command fails."""
    words = [str(argument) for argument in arguments]
    with subprocess.Popen([sys.executable, "-m", "stillwake", *words]) as process:
        try:
            status = process.wait()
        except BaseException:
            # The command deletes its own temporary files at its end. A stop signal may have reached only this process,
            # so the command is asked to end here.
            process.terminate()
            process.wait()
            raise
    if status != 0:
        raise StillwakeError(f"stillwake {' '.join(words)}: ended with status {status}")
