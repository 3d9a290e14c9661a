"""icoFoam as a child process: started with what it needs, watched, and never left behind."""

import ctypes
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import ClassVar, Final, Self

from contract.errors import PlantError
from contract.runtime.copies import NeverCopied

LOG: Final = "log.icoFoam"
PROGRAM: Final = "icoFoam"

_SHARE: Final = "/usr/share/openfoam"  # where the Debian package keeps its settings
_GRACE_S: Final = 5.0
_TAIL: Final = 6  # lines of the log in an error
_PR_SET_PDEATHSIG: Final = 1


def require_installed(program: str = PROGRAM) -> None:
    """Raise PlantError if icoFoam cannot be run here."""
    if shutil.which(program) is None:
        raise PlantError(f"the openfoam plant needs OpenFOAM's {program}: install the Debian package `openfoam`")


class IcoFoam(NeverCopied):
    """One run of icoFoam on a case; its output goes to the case's `log.icoFoam`. Raises PlantError if icoFoam is not
    installed. `command` is what to run in it; icoFoam, or another program in tests."""

    INSTEAD: ClassVar = "it is a process; start another one"

    def __init__(self, folder: Path, command: tuple[str, ...] = (PROGRAM,)) -> None:
        require_installed(command[0])
        self.folder = folder
        environment = {"WM_PROJECT_DIR": _SHARE, **os.environ}
        with (folder / LOG).open("ab") as log:
            # A group of its own, so that Ctrl-C reaches only this process, which then ends icoFoam in order.
            self._child = subprocess.Popen(
                command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                start_new_session=True, preexec_fn=_die_with_parent if sys.platform == "linux" else None,
            )  # fmt: skip

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def running(self) -> bool:
        return self._child.poll() is None

    def check(self) -> None:
        """Raise PlantError with the end of the log if icoFoam has failed."""
        status = self._child.poll()
        if status:
            raise self.failure(_ended(status))

    def failure(self, what: str) -> PlantError:
        """An error of one line with what happened and the log's end."""
        path = self.folder / LOG
        lines = [line.strip() for line in path.read_text(encoding="utf-8", errors="replace").splitlines()]
        tail = " | ".join([line for line in lines if line][-_TAIL:]) or "(nothing)"
        return PlantError(f"icoFoam {what}; {path} ends: {tail}")

    def stop(self) -> None:
        """End icoFoam, by force if it does not listen."""
        for end in (self._child.terminate, self._child.kill):
            if not self.running:
                return
            end()
            try:
                self._child.wait(_GRACE_S)
            except subprocess.TimeoutExpired:
                continue

    def wait(self, seconds: float) -> bool:
        """Wait for icoFoam's end at most this long; whether it has ended. Raises PlantError if it failed."""
        try:
            self._child.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        self.check()
        return True


def _ended(status: int) -> str:
    if status < 0:
        return f"was ended by {signal.Signals(-status).name}"
    return f"stopped with status {status}"


def _die_with_parent() -> None:
    """In the child: the kernel is to end it when the thread that started it does, however that happens."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
