"""`stillwake` commands as steps of a longer measurement, as a user would type them."""

import subprocess
import sys
from pathlib import Path
from typing import Final

from contract.errors import StillwakeError

ROOT: Final = Path(__file__).resolve().parents[2]

LOOP: Final = ("Cd_controlled", "reduction_percent", "abs_Cl_controlled", "mean_Cl_controlled", "rms_action")
"""Figures of `stillwake run --json` by which controllers are compared."""


def stillwake(*arguments: object) -> None:
    """Run one command of this source tree. Raises StillwakeError if it fails; the terminal has its messages."""
    words = [str(argument) for argument in arguments]
    with subprocess.Popen([sys.executable, "-m", "stillwake", *words]) as process:
        try:
            status = process.wait()
        except BaseException:
            # It clears its own files away: a stop that reached this process alone is passed on, and waited for.
            process.terminate()
            process.wait()
            raise
    if status != 0:
        raise StillwakeError(f"stillwake {' '.join(words)}: ended with status {status}")
