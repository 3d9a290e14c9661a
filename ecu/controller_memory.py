"""What the controller must be given again in the next control period: window, plan and actions under way.

The row of the window at period k is (Cp_k, a_{k-1}): the pressures now, and the action in force when they were
sampled. The plan of period k - 1 is where the optimisation of period k starts; the graph shifts it by one step.
The ECU and the policy that records under feedback (`bundle_policy`) share this memory.

Where a release serves a range of speeds, the periods' own rows are kept as well (`Past`), and the window is read
between them, at steps of the present speed. Pressures, actions and plan are then in units of the present speed; what is
sent and under way stays in units of the design speed, in which the jets' limits are.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from contract.arrays import Array, ArrayValue
from contract.controller.interface import FORCES, Controller, ControllerError, ControlStep
from contract.controller.resampling import followed, places


@dataclass(frozen=True)
class DelayLine:
    """The latest `delay + 1` values, oldest first; the line is always full. `values` is (delay + 1,)."""

    values: tuple[float, ...]

    @classmethod
    def filled(cls, delay: int, value: float = 0.0) -> Self:
        """A line on which `value` stands everywhere; `delay` in control periods."""
        return cls((value,) * (delay + 1))

    @property
    def in_force(self) -> float:
        """What takes effect now: given `delay` periods ago."""
        return self.values[0]

    @property
    def newest(self) -> float:
        """What was given last."""
        return self.values[-1]

    @property
    def pending(self) -> tuple[float, ...]:
        """What takes effect in the next `delay` periods, (delay,)."""
        return self.values[1:]

    def pushed(self, value: float) -> Self:
        """The line one period later, with `value` given now."""
        return type(self)((*self.values[1:], value))


@dataclass(frozen=True, kw_only=True, eq=False)
class Past(ArrayValue):
    """The rows of the latest control periods at the speeds they had; a value with read-only arrays.

    Attributes:
        rows: (N, S + 1) as in the window, each in units of its own speed; zero where none has come.
        speeds: (N,) in design speeds.
        count: how many have come.
    """

    rows: Array
    speeds: Array
    count: int

    @staticmethod
    def empty(periods: int, sensors: int) -> "Past":
        """Before the first row, for so many periods."""
        return Past(rows=np.zeros((periods, sensors + 1)), speeds=np.zeros(periods), count=0)

    def with_row(self, row: Array, speed: float) -> "Past":
        """Add this period's row, (S + 1,)."""
        return Past(
            rows=np.vstack([self.rows[1:], row]),
            speeds=np.append(self.speeds[1:], speed),
            count=min(self.count + 1, len(self.rows)),
        )

    def with_column(self, sensor: int, values: Array) -> "Past":
        """Put other pressures of one sensor, (N,), into the rows that have come."""
        rows, first = self.rows.copy(), len(self.rows) - self.count
        rows[first:, sensor] = values[first:]
        return replace(self, rows=rows)

    def read(self, length: int) -> tuple[Array, int]:
        """The window (L, S + 1) at steps of the present speed, and how many of its rows have come."""
        window, first = np.zeros((length, self.rows.shape[1])), len(self.rows) - self.count
        if not self.count:
            return window, 0
        read = places(self.speeds[first:].tolist(), length).of(self.rows[first:])
        window[length - len(read) :] = read
        return window, len(read)


@dataclass(frozen=True, kw_only=True, eq=False)
class ControllerMemory(ArrayValue):
    """A value: every method returns a new memory and leaves this one as it is. The arrays are read-only.

    Attributes:
        window: (L, S + 1), rows (Cp at the sensors, action in force), one for every control period, oldest first;
            zero where no row has come yet.
        rows: how many of them have come, the last ones of the window, 0 to L.
        gap: periods in a row without pressures.
        plan: (H,), as it came out of the controller; zeros without one.
        under_way: actions sent; the newest first takes effect when the actuator's delay is over.
        past: of a release that serves a range of speeds, from which the window is read.
    """

    window: Array
    rows: int
    gap: int
    plan: Array
    under_way: DelayLine
    past: Past | None = None

    @staticmethod
    def empty(*, length: int, sensors: int, horizon: int, delay: int, past: int = 0) -> "ControllerMemory":
        """No rows, a plan of zeros, no jet action.

        Args:
            length: L.
            sensors: S.
            horizon: H.
            delay: of the actuator, in control periods.
            past: periods that are kept for a release that serves a range of speeds; 0 for another.
        """
        return ControllerMemory(
            window=np.zeros((length, sensors + 1)),
            rows=0,
            gap=0,
            plan=np.zeros(horizon),
            under_way=DelayLine.filled(delay),
            past=Past.empty(past, sensors) if past else None,
        )

    @property
    def is_full(self) -> bool:
        """Whether the controller can plan."""
        return self.rows == len(self.window)

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """L, S, H and the actuator's delay: what two memories of one controller have in common."""
        return len(self.window), self.window.shape[1] - 1, len(self.plan), len(self.under_way.pending)

    @property
    def speed(self) -> float:
        """The speed of the newest row, in design speeds."""
        return 1.0 if self.past is None or not self.past.count else float(self.past.speeds[-1])

    def observed(self, cp: Array, speed: float = 1.0) -> "ControllerMemory":
        """Add a row for this period; cp is (S,), at that speed."""
        return self._extended(cp, speed, gap=0)

    def bridged(self, longest_gap: int) -> "ControllerMemory":
        """Add a stand-in for a period without pressures: the last ones again. Before the first row there is none.

        A gap of more than `longest_gap` periods empties the window, so that the controller never plans from
        pressures long past.
        """
        gap = min(self.gap, longest_gap) + 1
        if gap > longest_gap:
            return replace(self.emptied(), gap=gap)
        return self._extended(self.window[-1, :-1], self.speed, gap=gap) if self.rows else replace(self, gap=gap)

    def emptied(self) -> "ControllerMemory":
        """Without rows; plan and actions under way stay."""
        if not self.rows:
            return self
        past = None if self.past is None else Past.empty(len(self.past.rows), self.window.shape[1] - 1)
        return replace(self, window=np.zeros_like(self.window), rows=0, past=past)

    def with_column(self, sensor: int, values: Array) -> "ControllerMemory":
        """Put other pressures of one sensor into the rows that have come: (L,), or (N,) of a past."""
        if self.past is not None:
            past = self.past.with_column(sensor, values)
            return replace(self, past=past, window=past.read(len(self.window))[0])
        window = self.window.copy()
        first = len(window) - self.rows
        window[first:, sensor] = values[first:]
        return replace(self, window=window)

    def commanded(self, action: float) -> "ControllerMemory":
        """Add an action sent in this period, in U_inf W."""
        return replace(self, under_way=self.under_way.pushed(action))

    def with_delay(self, delay: int) -> "ControllerMemory":
        """Change to another delay of the actuator, between two control periods; `delay` is less than the horizon.

        What was sent stays as it was sent. What moves is when it is taken to act: under way are the latest `delay`
        actions, and a row of the window has the action that was in force by the new delay. An action from before the
        oldest row of the window is taken for that row's, which is zero where no row has come. The plan moves along:
        the action that it has for the next period is the same as before. A past begins again.
        """
        later = delay - len(self.under_way.pending)
        if not later:
            return self
        # The rows' actions and those on the line are the actions sent, without a gap.
        sent = np.concatenate([self.window[:, -1], self.under_way.values])
        length, first = len(self.window), len(self.window) - self.rows
        in_force = sent[np.maximum(np.arange(length) - later, 0)]
        under_way = sent[np.maximum(np.arange(length - later, len(sent)), 0)]
        window = self.window.copy()
        window[first:, -1] = in_force[first:]
        planned_at = np.arange(len(self.plan)) - later
        memory = self if self.past is None else self.emptied()
        return replace(
            memory,
            window=window if self.past is None else memory.window,
            plan=self.plan[planned_at.clip(0, len(self.plan) - 1)],
            under_way=DelayLine(tuple(under_way.tolist())),
        )

    def without_plan(self) -> "ControllerMemory":
        """Put zeros in place of the plan: the next optimisation starts from none."""
        return replace(self, plan=np.zeros_like(self.plan)) if self.plan.any() else self

    def planned(
        self, controller: Controller, weights: Array | None = None, limit: float | None = None
    ) -> tuple["ControllerMemory", ControlStep]:
        """One control step on a full window: the memory with the new plan, and what the controller answered. Raises
        ControllerError if there is no answer, or it is not a control step of this horizon in finite numbers, whatever
        the controller raised or returned.

        Args:
            weights: of the cost, (8,) in the order of `CostWeights`; the controller's own without.
            limit: bound on |a| in U_inf W, at any speed; likewise.
        """
        pending = self.under_way.pending
        plan, free = self.plan.copy(), np.ones(len(self.plan))
        # The graph shifts the plan by a step. What comes first then is under way to a late actuator: as sent,
        # whatever the gate, a hold or the wire made of the plan.
        plan[1 : 1 + len(pending)] = np.array(pending) / self.speed
        free[: len(pending)] = 0.0
        try:
            step = controller.control_step(self.window, plan, free, weights, self.speed, limit)
            horizon = len(self.plan)
            new_plan = _checked("plan", step.plan, (horizon,))
            forces = _checked("forecast", step.forces, (horizon, FORCES))
        except ControllerError:
            raise
        except Exception as error:  # whatever a controller does wrong must not stop the ECU
            raise ControllerError(f"the controller failed with {type(error).__name__}") from error
        return replace(self, plan=new_plan), replace(step, plan=new_plan, forces=forces)

    def _extended(self, cp: Array, speed: float, *, gap: int) -> "ControllerMemory":
        row = np.append(cp, self.under_way.in_force / speed)
        if self.past is not None:
            if self.past.count:
                row[:-1] = followed(self.past.rows[-1, :-1], cp, speed)
            past = self.past.with_row(row, speed)
            window, rows = past.read(len(self.window))
            return replace(self, window=window, rows=rows, gap=gap, past=past)
        window = np.vstack([self.window[1:], row])
        return replace(self, window=window, rows=min(self.rows + 1, len(window)), gap=gap)


def _checked(name: str, values: object, shape: tuple[int, ...]) -> Array:
    """A copy of a controller's output; raises ControllerError if it is anything but finite numbers of this shape."""
    if not isinstance(values, np.ndarray) or values.dtype.kind != "f" or values.shape != shape:
        raise ControllerError(f"the controller's {name} is no array of numbers of shape {shape}")
    if not np.isfinite(values).all():
        raise ControllerError(f"the controller's {name} is not finite")
    return values.astype(np.float64)
