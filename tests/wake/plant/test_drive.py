"""Speeds that vary: files and profiles; wind that varies, and a viscosity that changes, while the wake runs."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from contract.config.operating_point import OperatingPoint
from contract.config.plant import FlowConfig
from contract.errors import ConfigError, PlantError
from wake.plant.drive import PROFILES, Drive, Gust, find_drive
from wake.solver import boundary
from wake.solver.grid import Flow, Grid
from wake.solver.navier_stokes import FlowSolver
from wake.truck.truck_wake import TruckWake

POINT = OperatingPoint()
HEADER = "t_s,speed_m_per_s\n"


def test_speeds_lie_on_straight_lines_and_stay_at_both_ends():
    drive = Drive(name="", times=(0.0, 2.0, 4.0), speeds=(20.0, 30.0, 10.0)).after(3.0)
    assert [drive.speed(t) for t in (0.0, 3.0, 4.0, 5.0, 6.5, 7.0, 99.0)] == [20.0, 20.0, 25.0, 30.0, 15.0, 10.0, 10.0]
    # A convective time is 0.1 s here; the plant's clock stood at 7 when the run began.
    gusty = replace(drive, gust=Gust(amplitude=0.1, period=4.0))
    wind = gusty.wind(POINT, begin=7.0)
    assert wind(7.0 + 40.0) == pytest.approx(0.0)  # 25 m/s, and the gust's tenth t_c is a half period's end
    assert wind(7.0 + 31.0) == pytest.approx(20.5 / 25.0 - 1.0 + 0.1)
    assert wind(7.0) == pytest.approx(20.0 / 25.0 - 1.0)
    assert gusty.substeps(FlowConfig(), POINT).substeps == 39
    # A gust is a sine of whole cycles about the mean: it begins and ends without a jump.
    gust = Gust(amplitude=0.2, period=4.0, start=3.0, cycles=2)
    assert [gust(t) for t in (0.0, 3.0, 4.0, 6.0, 11.001, 50.0)] == pytest.approx([0.0, 0.0, 0.2, -0.2, 0.0, 0.0])


def test_profiles_stay_in_their_range_and_follow_the_operating_point():
    for name in PROFILES:
        slow, drive = (find_drive(name, OperatingPoint(speed=speed)) for speed in (10.0, 25.0))
        assert drive.speeds == pytest.approx([2.5 * speed for speed in slow.speeds])
        assert min(drive.speeds) >= 0.6 * 25.0 - 1e-9
        assert max(drive.speeds) <= 1.4 * 25.0 + 1e-9
        assert 20.0 <= drive.duration_s <= 80.0
    assert 3.6 * max(find_drive("wltc-high", POINT).speeds) == pytest.approx(123.7)
    assert find_drive("steady-100", POINT).wind(POINT)(3.0) == 0.0


def test_a_file_is_read_and_a_wrong_one_named_by_line_and_value(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text("\N{ZERO WIDTH NO-BREAK SPACE}speed_m_per_s, t_s,gear\n20,5,4\n22.5,7.5,5\n", encoding="utf-8")
    read = find_drive(str(path), POINT)
    assert (read.name, read.times, read.speeds) == ("mine.csv", (0.0, 2.5), (20.0, 22.5))
    wrong = {
        "time,speed\n0,20\n": "no column t_s",
        HEADER + "0,20\n1,nan\n": r"line 3: speed_m_per_s = 'nan' must be a number",
        HEADER + "0,20\n0,21\n": r"line 3: t_s = 0 comes after 0; times must rise",
        HEADER + "0,51\n": r"speed_m_per_s = 51 must be in 0\.\.50",
    }
    for text, message in wrong.items():
        path.write_text(text)
        with pytest.raises(ConfigError, match=message):
            find_drive(str(path), POINT)
    with pytest.raises(ConfigError, match="cannot be read"):
        find_drive(str(tmp_path / "none.csv"), POINT)
    with pytest.raises(ConfigError, match=r"drive 'steady-55': must be a file ending in \.csv, or one of steady-60"):
        find_drive("steady-55", POINT)


def test_a_stream_without_a_body_is_the_wind_everywhere_and_at_rest_with_its_pressure():
    """du/dt = dU/dt and grad p = 0, the equation of motion in the frame of a body that moves through still air."""
    grid = Grid(xf=np.linspace(-1.0, 5.0, 25), yf=np.linspace(-1.0, 1.0, 13))
    everywhere = boundary.Boundary(grid, lambda x, y: np.ones_like(np.asarray(x, dtype=float)))
    solver, gust = FlowSolver(grid, everywhere, 1 / 500), Gust(amplitude=0.3, period=1.0)
    for time in (0.13, 0.25, 0.8):
        flow = Flow.zeros(grid.shape)
        flow.u[:] = 1.0
        solver.run(flow, dt=0.01, steps=round(time / 0.01), action_from=0.0, action_to=0.0, wind=gust)
        # A hundred additions of numbers of order 1.
        np.testing.assert_allclose(flow.faces_u, 1.0 + 0.3 * np.sin(2 * pi * time), rtol=0, atol=1e-13)
        assert np.abs(flow.faces_v).max() < 1e-13
        # The projection divides what is left of rounding by the time step.
        assert np.abs(flow.cells_p).max() < 1e-10


def test_a_changed_viscosity_is_that_of_a_plant_built_with_it(coarse):
    developed, built = TruckWake(coarse.flow), TruckWake(replace(coarse.flow, reynolds=700.0))
    developed.reset(coarse.start)
    expected = built.reset(replace(coarse.start, origin=None))
    developed.set_reynolds(700.0)
    for _ in range(2):
        found = developed.sample()
        assert (found.Cd, found.Cl) == (expected.Cd, expected.Cl)
        np.testing.assert_array_equal(found.Cp, expected.Cp)
        expected, _ = built.advance(0.03), developed.advance(0.03)
    assert developed.state().origin == built.state().origin
    with pytest.raises(PlantError, match="reynolds"):
        developed.reset(coarse.start)
    with pytest.raises(PlantError, match="viscous number"):
        developed.set_reynolds(0.5)
    assert developed.config.reynolds == 700.0
