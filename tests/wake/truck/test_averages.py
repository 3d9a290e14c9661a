"""Averages over whole cycles, and the recirculation length, of signals and flows for which they are known."""

import numpy as np
import pytest

from contract.errors import PlantError
from contract.geometry import LENGTH
from wake.solver.grid import Flow, truck_grid
from wake.truck.averages import over_cycles, over_last_cycles
from wake.truck.develop import recirculation_length

DT = 0.2


def series(frequency: float, phase: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Instants and the lift of a wake with this shedding frequency."""
    t = DT * np.arange(1, count + 1)
    return t, np.sin(2.0 * np.pi * (frequency * t + phase))


def test_less_than_a_cycle_is_refused():
    t, lift = series(0.2, 0.0, 30)
    with pytest.raises(PlantError, match=r"crosses zero upwards 1 times in 30 samples: .* run longer"):
        over_cycles(t, lift)
    for count in [0, 1, 20]:
        with pytest.raises(PlantError, match=r"a whole cycle of 5\.00 t_c, so run longer"):
            over_last_cycles(np.linspace(0.0, DT * (count - 1), count), 0.2)


def test_the_last_cycles_of_a_known_frequency():
    """The mean of a sine over its whole cycles is zero wherever they begin; a transient at the start is left out."""
    t, lift = series(0.2, 0.37, 83)
    average = over_last_cycles(t, 0.2)
    assert (average.cycles, average.weights.sum()) == (3, pytest.approx(1.0, abs=1e-12))
    assert average.mean(lift) == pytest.approx(0.0, abs=1e-12)
    assert not average.weights[: 82 - 75].any()
    # A cycle of no whole number of samples is cut between them: a line's mean is its value in the middle of the span.
    t, _ = series(0.1994, 0.0, 200)
    average = over_last_cycles(t, 0.1994)
    middle = t[-1] - 0.5 * average.cycles / 0.1994
    assert average.mean(3.0 * t - 1.0) == pytest.approx(3.0 * middle - 1.0, abs=1e-12)
    # A controlled wake: little of the shedding is left, and something faster crosses zero in between.
    t = np.linspace(DT, 300 * DT, 300)
    lift = 0.05 * np.sin(2 * np.pi * 0.2 * t) + 0.1 * np.sin(2 * np.pi * 0.71 * t)
    drag = 0.8 + 0.02 * np.sin(2 * np.pi * 0.2 * t + 1.0)
    assert over_cycles(t, lift).cycles > 30
    assert over_last_cycles(t, 0.2).mean(drag) == pytest.approx(0.8, abs=1e-12)


def test_a_sine_and_its_drag():
    """A period of 24.2 control steps, never a whole number of samples."""
    frequency = 0.2066
    for count in (75, 140, 300):
        for phase in np.linspace(0.0, 1.0, 7, endpoint=False):
            t, lift = series(frequency, phase, count)
            average = over_cycles(t, 1.05 * lift)
            # A sine is straight where it crosses zero: the crossing is off by the third power of the phase between.
            assert average.frequency == pytest.approx(frequency, rel=2e-4), (count, phase)
            assert average.cycles in (int(count * DT * frequency), int(count * DT * frequency) - 1)
            assert average.mean(1.05 * lift) == pytest.approx(0.0, abs=2e-4)
            # Drag at twice the frequency, in any phase. The cut intervals carry the straight line's error:
            # (2 w dt)^2 / 12 of the amplitude over a step, once at either end.
            drag = 1.08 + 0.03 * np.cos(4.0 * np.pi * frequency * t + 0.7)
            assert average.mean(drag) == pytest.approx(1.08, abs=5e-5), (count, phase)
            columns = np.column_stack([1.05 * lift, drag])
            deviations = [1.05 / np.sqrt(2.0), 0.03 / np.sqrt(2.0)]
            assert average.std(columns) == pytest.approx(deviations, rel=5e-3), (count, phase)


def test_a_bubble_ends_where_the_axis_turns_downstream():
    """At the base at the least, at the outlet at the most. Backward flow ahead of the truck does not count."""
    grid = truck_grid(0.7)
    for turn, length in [(0.37, 0.37), (2.0, 2.0), (3.3, 3.3), (-1.0, 0.0), (100.0, 23.0 - LENGTH)]:
        flow = Flow.zeros(grid.shape)
        ahead = grid.xf[:, None] < LENGTH
        flow.faces_u[:] = grid.xf[:, None] - LENGTH - turn - 100.0 * np.abs(grid.yc) * ahead
        assert recirculation_length(grid, flow) == pytest.approx(length, abs=1e-9)
