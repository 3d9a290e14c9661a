"""The memory in C against the one in Python: window, plan and actions under way, and the control step's input."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.controller.interface import FORCES, TERMS, ControlStep
from firmware_sim.ecu.controller_memory import ControllerMemory
from stillwake.parts.c_samples import MODEL, MPC
from tests.examples import examples

SENSORS = 4
# As on the wire: Cp and actions far from anything a truck has, and every digit of a double.
NUMBERS = st.floats(-1e6, 1e6)
ROWS = st.lists(NUMBERS, min_size=SENSORS, max_size=SENSORS)


class Twins:
    """One memory in each language; every call is made on both."""

    def __init__(self, core) -> None:
        self.core, ecu = core, core.config.ecu
        self.gap = ecu.hold_periods + ecu.decay_periods
        self.c = core.ffi.new("sw_memory *")
        self.python = ControllerMemory.empty(
            length=MODEL.window, sensors=SENSORS, horizon=MPC.horizon, delay=ecu.frozen_actions
        )

    def observed(self, row) -> None:
        self.core.lib.sw_memory_observed(self.c, row)
        self.python = self.python.observed(np.array(row))

    def bridged(self, _) -> None:
        self.core.lib.sw_memory_bridged(self.c)
        self.python = self.python.bridged(self.gap)

    def emptied(self, _) -> None:
        self.core.lib.sw_memory_emptied(self.c)
        self.python = self.python.emptied()

    def commanded(self, row) -> None:
        self.core.lib.sw_memory_commanded(self.c, row[0])
        self.python = self.python.commanded(row[0])

    def without_plan(self, _) -> None:
        self.core.lib.sw_memory_without_plan(self.c)
        self.python = self.python.without_plan()

    def with_column(self, row) -> None:
        sensor = int(abs(row[0])) % SENSORS
        values = np.outer(np.arange(MODEL.window) + 0.1, row)
        self.core.lib.sw_memory_with_column(self.c, sensor, values.tolist())
        self.python = self.python.with_column(sensor, values[:, sensor])

    def planned(self, row) -> None:
        """A plan as the control step gives it, in float32; and the input that led to it, compared."""
        controller = Planner(np.float32(row[0]) * np.linspace(0, 1, MPC.horizon, dtype=np.float32))
        weights = np.arange(len(TERMS), dtype=np.float64) / 7
        self.python, _ = self.python.planned(controller, weights)
        found = self.core.ffi.new("sw_input *")
        self.core.lib.sw_memory_input(self.c, weights.astype(np.float32).tolist(), found)
        for name, expected in controller.given.items():
            values = np.array(as_list(getattr(found, name)), dtype=np.float32)
            np.testing.assert_array_equal(values, expected.astype(np.float32), err_msg=name)
        self.c.plan = controller.plan.tolist()

    def compare(self) -> None:
        found, expected = self.c, self.python
        assert (found.rows, found.gap) == (expected.rows, expected.gap)
        assert tuple(found.under_way) == expected.under_way.values
        np.testing.assert_array_equal(np.array(as_list(found.window)), expected.window)
        np.testing.assert_array_equal(np.array(list(found.plan)), expected.plan)


class Planner:
    """A controller that keeps what it is given, and answers with one plan."""

    def __init__(self, plan) -> None:
        self.plan = plan

    def control_step(self, window, plan, free, weights=None) -> ControlStep:
        self.given = {"window": window.copy(), "plan": plan.copy(), "free": free.copy(), "weights": weights.copy()}
        return ControlStep(
            plan=self.plan.astype(np.float64),
            forces=np.zeros((len(self.plan), FORCES)),
            terms=np.zeros(len(TERMS)),
            cost=0.0,
        )


def as_list(array) -> list:
    return [list(item) if hasattr(item, "__len__") else item for item in array]


@pytest.fixture
def twins(core) -> Twins:
    return Twins(core)


CALLS = ["observed", "bridged", "emptied", "commanded", "without_plan", "with_column", "planned"]
# Rows and commands come far more often than the rest, or no window would ever be full.
USUAL = ["observed", "commanded", "planned"] * 5


@examples(40)
@given(calls=st.lists(st.tuples(st.sampled_from([*USUAL, *CALLS]), ROWS), max_size=60))
def test_any_run_of_calls_leaves_the_same_memory(core, calls):
    twins = Twins(core)
    for name, row in calls:
        getattr(twins, name)(row)
        twins.compare()


def test_a_full_window_holds_the_latest_rows_with_the_actions_in_force(twins):
    delay = twins.core.config.ecu.frozen_actions
    for k in range(MODEL.window + 5):
        twins.observed([k + 0.1, k + 0.2, k + 0.3, k + 0.4])
        twins.commanded([float(k)])
        twins.compare()
    rows = as_list(twins.c.window)
    assert twins.c.rows == MODEL.window
    # The newest row is of the last period but for its command, which came after it.
    assert rows[-1] == [k + 0.1, k + 0.2, k + 0.3, k + 0.4, float(k - 1 - delay)]
    assert rows[0][0] == 5.1


def test_a_gap_is_bridged_by_the_last_pressures_and_then_empties_the_window(twins):
    for k in range(3):
        twins.observed([float(k)] * SENSORS)
    for missing in range(1, twins.gap + 3):
        twins.bridged(None)
        twins.compare()
        assert twins.c.rows == (3 + missing if missing <= twins.gap else 0)
        assert twins.c.gap == min(missing, twins.gap + 1)


def test_before_the_first_row_there_is_nothing_to_bridge_with(twins):
    twins.bridged(None)
    twins.compare()
    assert twins.c.rows == 0


def test_what_is_under_way_comes_first_and_is_not_free(twins):
    """As sent, in place of what the plan had there: the plan is shifted by one step in the control step."""
    core, delay = twins.core, twins.core.config.ecu.frozen_actions
    for k in range(delay):
        twins.commanded([0.25 * (k + 1)])
    twins.c.plan = [0.5] * MPC.horizon
    found = core.ffi.new("sw_input *")
    core.lib.sw_memory_input(twins.c, [0.0] * len(TERMS), found)
    assert list(found.plan) == [0.5, *(0.25 * (k + 1) for k in range(delay)), *[0.5] * (MPC.horizon - 1 - delay)]
    assert list(found.free) == [0.0] * delay + [1.0] * (MPC.horizon - delay)
