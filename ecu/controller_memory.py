"""The controller's state from one control period to the next: window, plan, and sent actions that are not yet in force.

Row k of the window is (Cp_k, a_{k-1}): the pressures of period k, and the action in force when they were sampled. The
optimisation of period k starts from the plan of period k - 1, which the graph shifts by one step. The ECU and the
policy that records under feedback (`bundle_policy`) share this state.

For a release with a range of speeds, the rows of past periods are also stored (`Past`). The window is interpolated from
these rows, so that from row to row the vehicle travels the distance of one control period at the design speed.
Pressures, actions and plan are then made dimensionless with the present speed; sent actions and the jets' limits are in
units of the design speed.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from contract.arrays import Array, ArrayValue
from contract.controller.interface import FORCES, Controller, ControllerError, ControlStep
from contract.controller.resampling import followed, places


@dataclass(frozen=True)
class DelayLine:
    """The latest `delay + 1` values that were sent to an actuator, oldest first."""

    values: tuple[float, ...]

    @classmethod
    def filled(cls, delay: int) -> Self:
        """Return a line of zeros; `delay` is in control periods."""
        return cls((0.0,) * (delay + 1))

    @property
    def in_force(self) -> float:
        """The value that takes effect now."""
        return self.values[0]

    @property
    def newest(self) -> float:
        return self.values[-1]

    @property
    def pending(self) -> tuple[float, ...]:
        """The values for the next `delay` periods in the order of time, shape (delay,)."""
        return self.values[1:]

    def pushed(self, value: float) -> Self:
        """Return the line one period later, with `value` as the newest."""
        return type(self)((*self.values[1:], value))


@dataclass(frozen=True, kw_only=True, eq=False)
class Past(ArrayValue):
    """The rows of the latest N control periods; an immutable value with read-only arrays.

    Attributes:
        rows: (N, S + 1) rows as in the window, each made dimensionless with the speed of its period; zero at first.
        speeds: (N,) speed of each period, as a ratio to the design speed.
        count: number of rows with data, up to N.
    """

    rows: Array
    speeds: Array
    count: int

    @staticmethod
    def empty(periods: int, sensors: int) -> "Past":
        """Return a past with space for this number of periods, and without data."""
        return Past(rows=np.zeros((periods, sensors + 1)), speeds=np.zeros(periods), count=0)

    def with_row(self, row: Array, speed: float) -> "Past":
        """Return the past with this period's row, (S + 1,), in place of the oldest row."""
        rows, speeds = np.vstack([self.rows[1:], row]), np.append(self.speeds[1:], speed)
        return Past(rows=rows, speeds=speeds, count=min(self.count + 1, len(rows)))

    def read(self, length: int) -> tuple[Array, int]:
        """Return the window (L, S + 1), at L equal steps of travelled distance, and the number of rows with data."""
        window, first = np.zeros((length, self.rows.shape[1])), len(self.rows) - self.count
        if not self.count:
            return window, 0
        read = places(self.speeds[first:].tolist(), length).of(self.rows[first:])
        window[length - len(read) :] = read
        return window, len(read)


@dataclass(frozen=True, kw_only=True, eq=False)
class ControllerMemory(ArrayValue):
    """The controller's state, an immutable value: every method returns a new memory. The arrays are read-only.

    Attributes:
        window: (L, S + 1) one row for each of L periods, oldest first: Cp at the S sensors and the action in force;
            zero before the first row.
        rows: number of rows with data, 0 to L; these are the last rows of the window.
        gap: number of consecutive periods without pressures.
        plan: (H,) plan for H steps, as computed by the controller; zeros without a plan.
        under_way: sent actions, which the actuator delays: the first takes effect now, the others in later periods.
        past: rows from which the window of a release with a range of speeds is interpolated; None for other releases.
    """

    window: Array
    rows: int
    gap: int
    plan: Array
    under_way: DelayLine
    past: Past | None = None

    @staticmethod
    def empty(*, length: int, sensors: int, horizon: int, delay: int, past: int = 0) -> "ControllerMemory":
        """Return a memory without rows, with a plan of zeros and no jet action. The sizes are L = `length`, S =
        `sensors`, H = `horizon` and N = `past`, 0 for a release without a range of speeds. `delay` is in periods."""
        window, plan, under_way = np.zeros((length, sensors + 1)), np.zeros(horizon), DelayLine.filled(delay)
        stored = Past.empty(past, sensors) if past else None
        return ControllerMemory(window=window, rows=0, gap=0, plan=plan, under_way=under_way, past=stored)

    @property
    def is_full(self) -> bool:
        """Whether every row of the window has data, so that the controller can plan."""
        return self.rows == len(self.window)

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """The sizes L, S and H, and the delay in periods. Only another controller or calibration changes them."""
        return len(self.window), self.window.shape[1] - 1, len(self.plan), len(self.under_way.pending)

    @property
    def speed(self) -> float:
        """The speed of the newest row, as a ratio to the design speed."""
        return 1.0 if self.past is None or not self.past.count else float(self.past.speeds[-1])

    def observed(self, cp: Array, speed: float = 1.0) -> "ControllerMemory":
        """Return the memory with this period's row. `cp` has shape (S,); `speed` is the ratio to the design speed."""
        return self._extended(cp, speed, gap=0)

    def bridged(self, longest_gap: int) -> "ControllerMemory":
        """Return the memory with the last pressures repeated. A gap above `longest_gap` empties the window."""
        gap = min(self.gap, longest_gap) + 1
        if gap > longest_gap:
            return replace(self.emptied(), gap=gap)
        return self._extended(self.window[-1, :-1], self.speed, gap=gap) if self.rows else replace(self, gap=gap)

    def emptied(self) -> "ControllerMemory":
        """Return the memory without its rows; the plan and the sent actions stay."""
        if not self.rows:
            return self
        past = None if self.past is None else Past.empty(len(self.past.rows), self.window.shape[1] - 1)
        return replace(self, window=np.zeros_like(self.window), rows=0, past=past)

    def with_column(self, sensor: int, values: Array) -> "ControllerMemory":
        """Replace one sensor's pressures in the rows with data; `values` is (L,), or (N,) in a memory with a past."""
        rows = self.window if self.past is None else self.past.rows
        count = self.rows if self.past is None else self.past.count
        changed, first = rows.copy(), len(rows) - count
        changed[first:, sensor] = values[first:]
        if self.past is None:
            return replace(self, window=changed)
        past = replace(self.past, rows=changed)
        return replace(self, past=past, window=past.read(len(self.window))[0])

    def commanded(self, action: float) -> "ControllerMemory":
        """Return the memory after `action`, in U_inf W, was sent in this period."""
        return replace(self, under_way=self.under_way.pushed(action))

    def with_delay(self, delay: int) -> "ControllerMemory":
        """Return the memory for another delay of the actuator; call this between two periods.

        `delay` is below the horizon. The latest `delay` sent actions are now under way. Each window row gets the
        action that would have been in force with the new delay, or the oldest row's action if no older action is
        stored. The plan is shifted, so that its action for the next period stays the same. `past` loses its rows.
        """
        later = delay - len(self.under_way.pending)
        if not later:
            return self
        # The rows' actions, followed by the delay line's actions, are the sent actions without a gap.
        acted = self.window[:, -1] if self.past is None else self.past.rows[:, -1] * self.past.speeds
        sent, length = np.concatenate([acted, self.under_way.values]), len(acted)
        under_way = sent[np.maximum(np.arange(length - later, len(sent)), 0)]
        planned_at = np.arange(len(self.plan)) - later
        plan = self.plan[planned_at.clip(0, len(self.plan) - 1)]
        memory = replace(self, plan=plan, under_way=DelayLine(tuple(under_way.tolist())))
        if self.past is not None:
            return memory.emptied()
        window, first = self.window.copy(), length - self.rows
        window[first:, -1] = sent[np.maximum(np.arange(first, length) - later, 0)]
        return replace(memory, window=window)

    def without_plan(self) -> "ControllerMemory":
        """Return the memory with a plan of zeros, so that the next optimisation starts from zeros."""
        return replace(self, plan=np.zeros_like(self.plan)) if self.plan.any() else self

    def planned(
        self, controller: Controller, weights: Array | None = None, limit: float | None = None
    ) -> tuple["ControllerMemory", ControlStep]:
        """Do one control step on a full window. `weights`, (8,), are in the order of `CostWeights`; `limit` bounds |a|,
        in units of the design speed. The defaults are the graph's values. Raises ControllerError if the controller
        fails in any way, or if its answer is not a control step of this horizon with finite numbers."""
        pending = self.under_way.pending
        plan, free = self.plan.copy(), np.ones(len(self.plan))
        # The graph shifts the plan by one step. The first actions of the shifted plan must be the actions that were
        # sent and are not yet in force; the gate, the mode HOLD or rounding may have changed these after planning.
        plan[1 : 1 + len(pending)] = np.array(pending) / self.speed
        free[: len(pending)] = 0.0
        try:
            step = controller.control_step(self.window, plan, free, weights, self.speed, limit)
            horizon = len(self.plan)
            new_plan = _checked("plan", step.plan, (horizon,))
            forces = _checked("forecast", step.forces, (horizon, FORCES))
        except ControllerError:
            raise
        except Exception as error:  # no error of a controller may stop the ECU
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
    if not isinstance(values, np.ndarray) or values.dtype.kind != "f" or values.shape != shape:
        raise ControllerError(f"the controller's {name} is not an array of numbers of shape {shape}")
    if not np.isfinite(values).all():
        raise ControllerError(f"the controller's {name} is not finite")
    return values.astype(np.float64)
