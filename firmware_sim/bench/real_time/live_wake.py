"""The built-in solver in a separate process, one control period ahead of the bus. An ECU that plans ahead sends the
action for a period one period early, so the solver has a whole period to compute the flow up to the next sampling
instant. If the solver is late, the vehicle sends no pressures then, and the flow's time falls behind by a period."""

import multiprocessing
import signal
import time
from collections.abc import Callable
from contextlib import nullcontext
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import median
from typing import Any, ClassVar, Final, NamedTuple, Self

import numpy as np

from contract.arrays import Array
from contract.config.body import layout_of
from contract.config.tree import Config
from contract.errors import PlantError, StillwakeError
from contract.runtime.copies import NeverCopied
from ecu.real_time.privileges import stay_ordinary
from wake.plant.drive import Drive
from wake.truck.truck_wake import TruckWake

_ROOM: Final = 0.9  # share of a control period that the solver may take without a warning; transfers need the rest
COARSE: Final = (0.75, 15)
"""Grid refinement and time steps per period of the fastest plant that is fine enough (docs/explanation/solver.md)."""
_LONGEST_END_S: Final = 5.0  # longest wait in s for the solver's process, which may have to finish a control period


class Speed(NamedTuple):
    """The computing time that a plant needs on this machine: median and longest wall time of a control period."""

    typical_ms: float
    worst_ms: float

    @classmethod
    def of(cls, wake: TruckWake, periods: int = 20, clock: Callable[[], float] = time.perf_counter) -> "Speed":
        """Measure the computing time of `periods` control periods with sampling; then restore the wake's state."""
        begin, times = wake.state(), []
        for _ in range(periods):
            began = clock()
            wake.advance(0.0)
            times.append((clock() - began) * 1e3)
        wake.reset(begin)
        return cls(median(times), max(times))

    def check(self, period_ms: float, *, refinement: float, substeps: int) -> str | None:
        """Return a warning if the plant is barely fast enough, else None. Raises PlantError if it is too slow."""
        if self.typical_ms > period_ms:
            lacking = self.typical_ms / (_ROOM * period_ms)
            coarser = f" (--set flow.refinement={COARSE[0]:g} --set flow.substeps={COARSE[1]})"
            raise PlantError(
                f"the wake takes {self.typical_ms:.1f} ms for a control period of {period_ms:g} ms on this machine "
                f"(flow.refinement = {refinement:g}, flow.substeps = {substeps}): it cannot keep up. Use a coarser "
                f"grid and longer steps{coarser if refinement > COARSE[0] else ''}, "
                f"or divide operating_point.speed by {lacking:.2g}"
            )
        if self.typical_ms > _ROOM * period_ms or self.worst_ms > period_ms:
            return (
                f"warning: the wake takes {self.typical_ms:.1f} ms, at worst {self.worst_ms:.1f} ms, for a control "
                f"period of {period_ms:g} ms: periods without pressures are to be expected"
            )
        return None


class LiveWake(NeverCopied):
    """A live wake in a separate process, as a context manager. The constructor takes seconds, and raises StillwakeError
    if the plant cannot be opened. `speed` is the computing time of a control period, measured before the start. The
    file `start` has the initial state; if it is None, the shipped state is interpolated to the grid in use. While the
    flow develops from this state, `progress` is called with (time done, total time) in t_c. The time steps in
    `config.flow` must be short enough for the speeds of `drive`."""

    INSTEAD: ClassVar = "its solver is a process; start another wake"

    def __init__(
        self,
        config: Config,
        start: Path | None = None,
        progress: Callable[[float, float], None] = lambda t, total: None,
        drive: Drive | None = None,
    ) -> None:
        self.layout = layout_of(config.body)
        # The process is spawned, not forked: a fork would also copy locks that this process's threads hold.
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
        """Return Cp as `Pressures.sampled` does; raise PlantError if the flow diverged or the process ended."""
        if self._is_busy and not self._pipe.poll():
            return None
        if self._is_busy:
            _, self._cp = self._answer()
            self._is_busy = False
        return np.asarray(self._cp)

    def drive(self, action: float) -> None:
        """Start computing a control period in which the jets ramp to `action`, unless a period is being computed."""
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
            self._process.join(_LONGEST_END_S)
            raise PlantError(f"the live wake's process ended with status {self._process.exitcode}") from error
        if isinstance(word[0], StillwakeError):
            raise word[0]
        return word

    def _end(self) -> None:
        self._pipe.close()
        self._process.join(_LONGEST_END_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def _run(pipe: Connection, config: Config, start: Path | None, drive: Drive | None) -> None:
    """Run in the solver's process: let the flow develop, then compute one control period for each received action."""
    # A terminal or a service manager may signal all processes, but only the vehicle's process may end this process.
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    stay_ordinary()
    from firmware_sim.bench.disturbing import driving
    from wake.plants import own_wake

    try:
        wake = own_wake(config, lambda *at: pipe.send(("settling", *at)), start=start)
        wake.advance(0.0)
        speed = Speed.of(wake)
        with nullcontext() if drive is None else driving(wake, drive, config):
            pipe.send(("ready", speed, wake.description, wake.sample().Cp))
            while True:
                pipe.send(("sample", wake.advance(pipe.recv()).Cp))
    except StillwakeError as error:
        pipe.send((error,))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        # The pipe is closed, so the vehicle has ended.
        return
