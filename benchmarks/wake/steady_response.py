"""What a pulse of the jets does to the steady wake: how fast it grows, in which modes, and what undoing it takes.

    python -m benchmarks steady-response [--state steady.npz] [--json FILE]

A pulse so small that the answer is linear for 80 t_c. With actions held by the plant's ramps, the answer to a pulse in
one command is the discrete impulse response h_k, and every other linear answer is a sum of shifted ones.

- **Modes** by the eigensystem realisation algorithm (Juang and Pappa, J. Guidance 8, 1985) on h_k e^{-s k dt}: the
  weight makes early and late parts equally large; s is added to the growth rates found.
- **Undoing**: with a kick at t = 0 known exactly, the least actions from some lag on that leave the wake as still as
  they can: min |h * (kick + a)|^2 + R |a|^2. It is a bound; no controller knows the kick.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import scipy.linalg
import typer
from numpy.lib.stride_tricks import sliding_window_view
from rich.table import Table

from benchmarks.common.command_line import JsonFile, console, save, track
from contract.arrays import Array
from contract.geometry import LENGTH
from contract.results import versions
from contract.sensors import TRUCK
from wake.truck.state import State, load_state
from wake.truck.steady import settle
from wake.truck.truck_wake import TruckWake

PULSE: Final = 1e-6
"""In U_inf W: far above rounding, and linear until it has grown by 1e5."""
PAIRS: Final = (("upper_39", "lower_39"), ("base_0", "base_9"))
BEHIND: Final = tuple(0.5 * k for k in range(1, 15))
"""Where the transverse velocity is followed on the axis, in W behind the base."""
_JET: Final = 2
"""Control steps in which pressure answers the jets' acceleration alone."""
_DAMPING: Final = 1e4
"""R: actions weigh little against a wake that has grown a thousand times, and bound the solution."""


@dataclass(frozen=True, kw_only=True)
class Mode:
    """An unstable pair: growth rate in 1 / t_c, frequency in U_inf / W."""

    growth: float
    frequency: float


def main(
    json_file: JsonFile = None,
    state: Annotated[Path | None, typer.Option(help="The steady wake, from `stillwake steady`; else made.")] = None,
    duration: Annotated[float, typer.Option(help="Time after the pulse, t_c.", min=60.0)] = 90.0,
) -> None:
    """Answer, modes, and what undoing takes."""
    wake = TruckWake()
    start = settle(wake).state if state is None else load_state(state)
    pressures, velocities = response(wake, start, round(duration / wake.config.control_period))
    dt = wake.config.control_period
    both = np.concatenate([pressures, velocities], axis=1)
    growth = [
        {"t_c": t, "velocity": float(np.abs(velocities[_at(t, dt)]).max()), "pressure": _largest(pressures, t, dt)}
        for t in (5.0, 20.0, 40.0, 60.0, 80.0)
        if t + 5.0 <= duration
    ]
    found = {order: unstable(pressures[_JET:330], order, dt) for order in (18, 20, 22)}
    lags = [{"lag_t_c": lag * dt} | undone(velocities, lag, dt) for lag in (1, 5, 13, 25, 38, 50)]
    figures: dict[str, Any] = {
        "growth": growth,
        "rate": late_rate(both, dt),
        "modes": {str(order): [vars(mode) for mode in modes] for order, modes in found.items()},
        "undoing": lags,
    }
    _print(figures)
    facts = {
        "plant": wake.description,
        "pulse": PULSE,
        "sensors": [list(pair) for pair in PAIRS],
        "behind_base": list(BEHIND),
        "duration": duration,
        "damping": _DAMPING,
        "versions": versions("stillwake", "numpy", "numba", "scipy"),
    }
    save(json_file, figures=figures, facts=facts)


def response(wake: TruckWake, start: State, steps: int) -> tuple[Array, Array]:
    """h_k for a unit pulse: differences of mirror-placed pressures (steps, 2), v on the axis (steps, stations)."""
    before = wake.reset(start)
    columns = [TRUCK.indices(pair) for pair in PAIRS]
    middle = wake.grid.shape[1] // 2
    stations = [int(np.argmin(np.abs(wake.grid.xc - LENGTH - x))) for x in BEHIND]
    pressures, velocities = [], []
    for k in track(range(steps), "pulse", "periods"):
        sample = wake.advance(PULSE if k == 0 else 0.0)
        Cp = sample.Cp - before.Cp
        pressures.append([Cp[upper] - Cp[lower] for upper, lower in columns])
        velocities.append(wake.flow.faces_v[stations, middle])
    return np.array(pressures) / PULSE, np.array(velocities) / PULSE


def late_rate(h: Array, dt: float) -> float:
    """Growth rate of the largest channel between 55 and 80 t_c, in 1 / t_c: two halves of it, compared by their rms."""
    late = h[round(55.0 / dt) : round(80.0 / dt)]
    first, second = np.split(late[: len(late) // 2 * 2], 2)
    rms = [np.sqrt((half**2).mean(axis=0)).max() for half in (first, second)]
    return float(np.log(rms[1] / rms[0]) / (len(first) * dt))


def unstable(h: Array, order: int, dt: float, shift: float = 0.18) -> list[Mode]:
    """Growing oscillations of an impulse response (n, channels), fastest first.

    Args:
        order: of the realisation.
        shift: s in 1 / t_c; near the largest growth rate.
    """
    weighted = h * np.exp(-shift * dt * np.arange(len(h)))[:, None]
    weighted = weighted / np.abs(weighted).max(axis=0)
    columns = (len(h) - 1) // 2
    hankel = sliding_window_view(weighted, columns, axis=0)
    first, second = (hankel[k : k + columns].reshape(-1, columns) for k in (0, 1))
    left, sizes, right = scipy.linalg.svd(first, full_matrices=False)
    scale = 1.0 / np.sqrt(sizes[:order])
    system = (scale[:, None] * left[:, :order].T) @ second @ (right[:order].T * scale)
    rates = np.log(scipy.linalg.eigvals(system).astype(complex)) / dt + shift
    growing = [Mode(growth=float(s.real), frequency=float(s.imag / (2.0 * np.pi))) for s in rates if s.imag > 0]
    return sorted((mode for mode in growing if mode.growth > 0.0), key=lambda mode: -mode.growth)


def undone(velocities: Array, lag: int, dt: float) -> dict[str, float]:
    """The least-squares actions, from `lag` control steps after a unit kick until 40 t_c.

    Returns:
        `action`: the largest one, in kicks; `left`: velocities over the last 10 t_c, as a share of those without.
    """
    steps, stations = velocities.shape
    last = round(40.0 / dt)
    answers = np.vstack(
        [
            scipy.linalg.toeplitz(velocities[:, j], np.r_[velocities[0, j], np.zeros(steps - 1)])[:, lag:last]
            for j in range(stations)
        ]
    )
    kick = velocities.T.ravel()
    matrix = np.vstack([answers, np.sqrt(_DAMPING) * np.eye(last - lag)])
    actions = np.linalg.lstsq(matrix, np.r_[-kick, np.zeros(last - lag)], rcond=None)[0]
    after = (kick + answers @ actions).reshape(stations, steps)[:, -round(10.0 / dt) :]
    alone = kick.reshape(stations, steps)[:, -round(10.0 / dt) :]
    return {"action": float(np.abs(actions).max()), "left": float(np.linalg.norm(after) / np.linalg.norm(alone))}


def _at(t: float, dt: float) -> slice:
    return slice(round(t / dt), round((t + 5.0) / dt))


def _largest(h: Array, t: float, dt: float) -> float:
    return float(np.abs(h[_JET:][_at(t, dt)]).max())


def _print(figures: dict[str, Any]) -> None:
    growth = Table("from t_c on", "velocity a kick", "pressure a kick")
    for row in figures["growth"]:
        growth.add_row(f"{row['t_c']:g}", f"{row['velocity']:.3g}", f"{row['pressure']:.3g}")
    lags = Table("lag, t_c", "largest action, kicks", "left of the wake's motion")
    for row in figures["undoing"]:
        lags.add_row(f"{row['lag_t_c']:g}", f"{row['action']:.3g}", f"{row['left']:.2g}")
    console.print(growth, lags)
    for order, modes in figures["modes"].items():
        pairs = ", ".join(f"{mode['growth']:.3f} at {mode['frequency']:.3f}" for mode in modes)
        console.print(f"order {order}: growing pairs {pairs}")
    console.print(f"late growth rate {figures['rate']:.3f} / t_c")
