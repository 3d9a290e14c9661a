"""The child process icoFoam, and the pipes through which its jets and inlet are controlled step by step.

The boundary condition of jets and inlet (`wake.openfoam.case`) reads the velocity at listed instants from one file for
each instant. In the time step after an instant, the condition opens the file of the next instant. Here the end of every
time step is an instant, and the files are named pipes, one for each patch. So icoFoam waits at the start of each time
step until it receives the velocities at the step's end. Before it waits, it writes all measurements of the step before.
"""

import ctypes
import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import ClassVar, Final, Self

from contract.errors import PlantError
from contract.runtime.copies import NeverCopied
from wake.openfoam import case
from wake.openfoam.mesh import Mesh

LOG: Final = "log.icoFoam"
PROGRAM: Final = "icoFoam"
_SHARE: Final = "/usr/share/openfoam"  # folder of the settings of the Debian package
_GRACE_S: Final = 5.0
_TAIL: Final = 6  # number of the log's last lines in an error message
_PR_SET_PDEATHSIG: Final = 1


def require_installed(program: str = PROGRAM) -> None:
    """Raise PlantError if icoFoam cannot be run here."""
    if shutil.which(program) is None:
        raise PlantError(f"the openfoam plant needs OpenFOAM's {program}: install the Debian package `openfoam`")


PATIENCE_S: Final = 120.0
"""Longest wait for one time step, in s; a step takes well under a second on a free core."""
_POLL_S: Final = (2e-4, 5e-3)


class IcoFoam(NeverCopied):
    """A run of icoFoam on a case; its output goes to the case's `log.icoFoam`. A case with pipes (`case.write_pipes`)
    needs its mesh, and runs step by step: each call of `send` starts a step. `patience_s` is the longest wait for one
    time step, in s; `command` replaces icoFoam in tests. Raises PlantError if icoFoam is not installed."""

    INSTEAD: ClassVar = "icoFoam is a process; start another process"

    def __init__(
        self,
        folder: Path,
        mesh: Mesh | None = None,
        *,
        patience_s: float = PATIENCE_S,
        command: tuple[str, ...] = (PROGRAM,),
    ) -> None:
        require_installed(command[0])
        self.folder, self._mesh, self._patience_s = folder, mesh, patience_s
        self._waiting: int | None = None
        environment = {"WM_PROJECT_DIR": _SHARE, **os.environ}
        with (folder / LOG).open("ab") as log:
            # The child has its own process group. Ctrl-C then reaches only this process, which ends icoFoam.
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
            ended = f"stopped with status {status}" if status > 0 else f"was ended by {signal.Signals(-status).name}"
            raise self.failure(ended)

    def failure(self, what: str) -> PlantError:
        """Return an error whose one-line message contains `what` and the end of the log."""
        path = self.folder / LOG
        lines = [line.strip() for line in path.read_text(encoding="utf-8", errors="replace").splitlines()]
        tail = " | ".join([line for line in lines if line][-_TAIL:]) or "(nothing)"
        return PlantError(f"icoFoam {what}; the last lines of {path}: {tail}")

    def stop(self) -> None:
        """End icoFoam, and close its pipes. If icoFoam does not end in time, kill it."""
        for end in (self._child.terminate, self._child.kill):
            if not self.running:
                break
            end()
            with suppress(subprocess.TimeoutExpired):
                self._child.wait(_GRACE_S)
        if self._waiting is not None:
            os.close(self._waiting)
            self._waiting = None

    def wait(self, seconds: float) -> bool:
        """Wait up to `seconds` for icoFoam's end; return whether it has ended. Raises PlantError if it failed."""
        try:
            self._child.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        self.check()
        return True

    def wait_for_step(self) -> None:
        """Wait until icoFoam finishes its step and opens the pipes. Raises PlantError if it ends or takes too long."""
        if self._waiting is None:
            self._waiting = self._open(case.DRIVEN[0])

    def send(self, action: float, stream: float = 1.0) -> None:
        """Let icoFoam take a time step. At its end the jets' flow rate is `action` (in U_inf W), and the free stream is
        `stream` (in U_inf). Raises the errors of `wait_for_step`."""
        assert self._mesh is not None, "a case without pipes runs by itself"
        self.wait_for_step()
        for patch in case.DRIVEN:
            reader = self._open(patch) if self._waiting is None else self._waiting
            self._waiting = None
            try:
                # A pipe accepts the text, at most a few thousand bytes, in one write.
                os.write(reader, case.velocities(self._mesh, patch, action, stream).encode("ascii"))
            except BrokenPipeError:
                self.wait(1.0)
                raise self.failure("closed its end of a pipe") from None
            finally:
                os.close(reader)

    def _open(self, patch: str) -> int:
        path, pause = case.pipe(self.folder, patch), _POLL_S[0]
        deadline = time.monotonic() + self._patience_s
        while True:
            try:
                return os.open(path, os.O_WRONLY | os.O_NONBLOCK)
            except OSError as error:
                if error.errno != errno.ENXIO:
                    raise PlantError(f"{path}: {error.strerror}") from error
            if not self.running:
                self.check()
                raise self.failure("reached its end")
            if time.monotonic() > deadline:
                raise self.failure(f"has not finished a time step in {self._patience_s:g} s")
            time.sleep(pause)
            pause = min(2.0 * pause, _POLL_S[1])


def _die_with_parent() -> None:
    """Let the kernel kill this child process as soon as the thread that started the process has ended."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
