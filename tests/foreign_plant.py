"""A plant that is not the truck's: a forced Stuart-Landau oscillator behind seven sensors without mirror images.

Written by itself, with SciPy's integrator, so that nothing of the package makes the data that it is tested on.
"""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import h5py
import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

Array = npt.NDArray[np.float64]

NAMES = ("tap A", "p#2", "Ø3", "lid-left", "0", "x.y", "q'")
POSITIONS = ((0.1, 0.5), (0.4, 0.55), (0.7, 0.5), (1.0, 0.31), (1.0, 0.0), (1.0, -0.12), (0.6, -0.5))
BASE = ("lid-left", "0", "x.y")
PERIOD = 0.3  # control period, t_c
LIMIT = 0.2
FREQUENCY = 0.15  # of the free oscillator, 1/t_c: 22 control steps to a cycle


def series(steps: int, seed: int, *, forced: bool = True) -> dict[str, Array]:
    """t, action, Cd, Cl (n,), and Cp (n, 7); the action ramps from one command to the next over a period."""
    return {name: values.copy() for name, values in _series(steps, seed, forced).items()}


@cache
def _series(steps: int, seed: int, forced: bool) -> dict[str, Array]:
    generator = np.random.default_rng(seed)
    t = PERIOD * np.arange(steps)
    phase = 2 * np.pi * np.cumsum(FREQUENCY * (1 + 0.4 * np.sin(t / 7.0 + generator.uniform(0, 6)))) * PERIOD
    action = 0.9 * LIMIT * np.sin(phase) * (0.7 + 0.3 * np.sin(t / 11.0)) if forced else np.zeros(steps)

    def rate(now: float, state: Array) -> Array:
        z = complex(*state)
        jet = np.interp(now - PERIOD, t, action)
        change = (0.3 + 2j * np.pi * FREQUENCY) * z - (0.3 + 0.1j) * abs(z) ** 2 * z + 2.0 * jet
        return np.array([change.real, change.imag])

    start = np.exp(1j * generator.uniform(0, 2 * np.pi))
    solved = solve_ivp(rate, (0.0, t[-1]), [start.real, start.imag], t_eval=t, max_step=0.3)
    z = solved.y[0] + 1j * solved.y[1]
    shift = np.linspace(0.0, 2.0, len(NAMES))
    pressure = -0.3 + 0.2 * np.real(z[:, None] * np.exp(1j * shift)) + 0.05 * np.abs(z[:, None]) ** 2
    pressure += 1e-3 * generator.standard_normal(pressure.shape)
    return {
        "t": t,
        "action": action,
        "Cd": 1.2 + 0.15 * np.abs(z) ** 2 + 0.03 * np.real(z**2),
        "Cl": 0.1 + np.real(z * np.exp(0.7j)),
        "Cp": pressure,
    }


def write_sensors(path: Path) -> Path:
    rows = [f"{name},{x},{y},{int(name in BASE)}" for name, (x, y) in zip(NAMES, POSITIONS, strict=True)]
    path.write_text("\n".join(["name,x,y,base", *rows]) + "\n", encoding="utf-8")
    return path


def write_csv(path: Path, values: Mapping[str, Array]) -> Path:
    """A column a series and a sensor, in 17 digits."""
    columns = {name: array for name, array in values.items() if name != "Cp"}
    columns |= dict(zip(NAMES, values["Cp"].T, strict=True))
    rows = (",".join(repr(float(value)) for value in row) for row in zip(*columns.values(), strict=True))
    path.write_text("\n".join([",".join(columns), *rows]) + "\n", encoding="utf-8")
    return path


def write_npz(path: Path, values: Mapping[str, Array]) -> Path:
    """One array Cp."""
    np.savez(path, **values)  # type: ignore[arg-type]  # numpy's stub takes the keyword allow_pickle for one of ours
    return path


def write_hdf5(path: Path, values: Mapping[str, Array]) -> Path:
    """An array a sensor, in a group; series as one row, as MATLAB writes them."""
    with h5py.File(path, "w") as file:
        for name in ("t", "action", "Cd", "Cl"):
            file[name] = values[name][None, :]
        for name, column in zip(NAMES, values["Cp"].T, strict=True):
            file[name] = column
    return path


WRITERS = {".csv": write_csv, ".npz": write_npz, ".h5": write_hdf5}
