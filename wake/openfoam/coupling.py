"""Step-by-step coupling of icoFoam's jets through named pipes, without compiling anything.

The jets' boundary condition (`wake.openfoam.jets`) opens the file of its next instant in the first time step after the
last one. Here every time step's end is such an instant, and its file is a named pipe, one a jet. So icoFoam stops at
the start of each time step, when everything about the last one has been measured and written, until the
jets' velocity at the step's end arrives. A ramp can then start at any time step of a control period, as on the own
plant.
"""

import errno
import os
import time
from pathlib import Path
from typing import ClassVar, Final, Self

from contract.errors import PlantError
from contract.runtime.copies import NeverCopied
from wake.openfoam import jets
from wake.openfoam.jets import JETS
from wake.openfoam.mesh import Mesh
from wake.openfoam.process import IcoFoam

PATIENCE_S: Final = 120.0
"""Longest wait for one time step; one takes well under a second on a free core."""

_POLL_S: Final = (2e-4, 5e-3)


class JetPipes(NeverCopied):
    """The controller's ends of the pipes.

    Args:
        folder: the case, as `jets.write_pipes` has laid it out.
        patience_s: longest wait for one time step.
    """

    INSTEAD: ClassVar = "it holds pipes to a process; make others"

    def __init__(self, folder: Path, mesh: Mesh, child: IcoFoam, patience_s: float = PATIENCE_S) -> None:
        self._folder = folder
        self._mesh = mesh
        self._child = child
        self._patience_s = patience_s
        self._waiting: int | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def wait(self) -> None:
        """Return when icoFoam has finished its time step and asks for the next. Raises PlantError if it ends or takes
        too long."""
        if self._waiting is None:
            self._waiting = self._open(JETS[0])

    def send(self, action: float) -> None:
        """Let icoFoam take one time step, at whose end the jets have this flow rate. Raises PlantError as `wait`."""
        self.wait()
        for jet in JETS:
            reader = self._open(jet) if self._waiting is None else self._waiting
            self._waiting = None
            try:
                # A few hundred bytes: a pipe takes them whole and at once.
                os.write(reader, jets.velocities(self._mesh, jet, action).encode("ascii"))
            except BrokenPipeError:
                self._child.wait(1.0)
                raise self._child.failure("closed its end of a pipe") from None
            finally:
                os.close(reader)

    def close(self) -> None:
        """Close what is open; icoFoam, if it waits there, then fails."""
        if self._waiting is not None:
            os.close(self._waiting)
            self._waiting = None

    def _open(self, jet: str) -> int:
        path, pause = jets.pipe(self._folder, jet), _POLL_S[0]
        deadline = time.monotonic() + self._patience_s
        while True:
            try:
                return os.open(path, os.O_WRONLY | os.O_NONBLOCK)
            except OSError as error:
                if error.errno != errno.ENXIO:
                    raise PlantError(f"{path}: {error.strerror}") from error
            if not self._child.running:
                self._child.check()
                raise self._child.failure("came to its end")
            if time.monotonic() > deadline:
                raise self._child.failure(f"has not finished a time step in {self._patience_s:g} s")
            time.sleep(pause)
            pause = min(2.0 * pause, _POLL_S[1])
