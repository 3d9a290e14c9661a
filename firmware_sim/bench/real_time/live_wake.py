"""The own solver in a process of its own, one control period ahead of the bus.

At a sampling instant the action of the period to come is known: an ECU that plans ahead sends it early. So the
solver has the whole period to get to the next sampling instant. If it does not, that instant passes without pressures,
and the flow's time falls behind the clock's by a period.
"""

import multiprocessing
import signal
from collections.abc import Callable
from contextlib import nullcontext
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, ClassVar, Final, Self

import numpy as np

from contract.arrays import Array
from contract.config.body_sensors import layout_of
from contract.config.tree import Config
from contract.errors import PlantError, StillwakeError
from contract.runtime.copies import NeverCopied
from ecu.real_time.privileges import stay_ordinary
from firmware_sim.bench.real_time.speed import Speed
from wake.plant.drive import Drive

LONGEST_END_S: Final = 5.0
"""What the process is given to end by itself: the longest control period, and Python's own end."""


class LiveWake(NeverCopied):
    """Use as a context manager; its start takes seconds. Raises StillwakeError if the plant cannot be made.

    Args:
        start: a state to begin from; the shipped one, moved to the grid in use, without.
        progress: called with (t_c, t_c in all) while the start settles.
        drive: speeds of the stream from the first period on; the flow's settings have the time steps for them.

    Attributes:
        layout: sensors of the body.
        description: solver, grid and time step.
        speed: measured before the start.
    """

    INSTEAD: ClassVar = "its solver is a process; make another one"

    def __init__(
        self,
        config: Config,
        start: Path | None = None,
        progress: Callable[[float, float], None] = lambda t, total: None,
        drive: Drive | None = None,
    ) -> None:
        self.layout = layout_of(config.body)
        # Not forked: this process has threads, whose locks a fork would keep as they are.
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_run, args=(theirs, config, start, drive), name="live-wake", daemon=True)
        self._process.start()
        theirs.close()
        try:
            while (word := self._answer())[0] == "settling":
                progress(*word[1:])
        except BaseException:
            self._end()
            raise
        _, self.speed, about, self._cp = word
        self.description = f"live wake: {about}"
        self._is_busy = False

    def sampled(self) -> Array | None:
        """Cp at the end of the period that was driven last; None while it is being computed. Raises PlantError if the
        flow diverged or its process died."""
        if self._is_busy and not self._pipe.poll():
            return None
        if self._is_busy:
            _, self._cp = self._answer()
            self._is_busy = False
        return np.asarray(self._cp)

    def drive(self, action: float) -> None:
        """Advance a control period, the jets ramping to `action`; while one is under way, nothing: see `sampled`."""
        if not self._is_busy:
            try:
                self._pipe.send(action)
            except OSError as error:
                raise PlantError(f"the live wake's process ended: {error}") from error
            self._is_busy = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def _answer(self) -> tuple[Any, ...]:
        try:
            word: tuple[Any, ...] = self._pipe.recv()
        except (EOFError, OSError) as error:
            self._process.join(LONGEST_END_S)
            raise PlantError(f"the live wake's process ended with status {self._process.exitcode}") from error
        if isinstance(word[0], StillwakeError):
            raise word[0]
        return word

    def _end(self) -> None:
        self._pipe.close()
        self._process.join(LONGEST_END_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def _run(pipe: Connection, config: Config, start: Path | None, drive: Drive | None) -> None:
    """The process: settle, then a control period for every action that comes."""
    # A stop may go to all processes of a terminal or a service; the vehicle ends this one after its farewell.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    stay_ordinary()
    from firmware_sim.bench.driven import driving
    from firmware_sim.bench.real_time.speed import measured
    from wake.plants import open_plant
    from wake.truck.truck_wake import TruckWake

    def send(*word: object) -> None:
        pipe.send(word)

    try:
        with open_plant("wake", Path(), config, progress=lambda *at: send("settling", *at), start=start) as wake:
            assert isinstance(wake, TruckWake)
            wake.advance(0.0)
            speed = Speed.of(measured(wake))
            with nullcontext() if drive is None else driving(wake, drive, config):
                send("ready", speed, wake.description, wake.sample().Cp)
                while True:
                    sample = wake.advance(pipe.recv())
                    send("sample", sample.Cp)
    except StillwakeError as error:
        send(error)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        # The vehicle has closed the pipe.
        return
