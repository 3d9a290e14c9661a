"""QR pivots of pressures whose POD modes are known exactly."""

import numpy as np
import torch

from contract import sensors
from train.samples.rows import Rows
from train.selection.qr_pivoting import select_qr

PEAKS = (12, 83, 55)
"""Sensor where each mode is largest."""


def rows_of(pressure: np.ndarray) -> Rows:
    inputs = torch.from_numpy(np.column_stack([pressure, np.zeros(len(pressure))]).astype(np.float32))
    zeros = torch.zeros(len(inputs))
    return Rows(inputs=inputs, actions=zeros, forces=torch.zeros(len(inputs), 2), lengths=(len(inputs),))


def concentrated() -> tuple[Rows, np.ndarray]:
    """Three modes on disjoint sensors, each largest at its peak, with amplitudes that do not correlate."""
    modes = np.zeros((sensors.COUNT, 3))
    for number, peak in enumerate(PEAKS):
        modes[peak, number] = 2.0
        modes[[peak - 1, peak + 1], number] = 1.0
    modes /= np.sqrt(6.0)
    t = 2 * np.pi * np.arange(400) / 400
    amplitudes = np.column_stack([3.0 * np.sin(t), 2.0 * np.cos(2 * t), np.sin(5 * t)])
    return rows_of(amplitudes @ modes.T), modes


def test_pivots_are_the_peaks_of_disjoint_modes():
    rows, _ = concentrated()
    assert set(select_qr(rows, 3)) == set(PEAKS)
    assert select_qr(rows, 1) == (PEAKS[0],)  # of one mode, the strongest
    assert set(select_qr(rows, 2)) == set(PEAKS[:2])
    # A sensor that repeats a pivot is passed over.
    # Sensors 10 and 11 hear the same amplitude, 70 another at half the strength: QR takes one of the two, then 70.
    t = 2 * np.pi * np.arange(200) / 200
    pressure = np.zeros((200, sensors.COUNT))
    pressure[:, 10] = pressure[:, 11] = np.sin(t)
    pressure[:, 70] = 0.5 * np.cos(t)
    first, second = select_qr(rows_of(pressure), 2)
    assert {first, second} in ({10, 70}, {11, 70})
    # More modes than sensors are used as told.
    # Sensor 5 is largest in the strong mode, 8 has the longest row of both: 0.36 / 2.17 + 0.81 / 1.17.
    t = 2 * np.pi * np.arange(400) / 400
    strong, weak = np.zeros(sensors.COUNT), np.zeros(sensors.COUNT)
    strong[[5, 6, 8]], weak[[6, 8]] = (1.0, 0.9, 0.6), (0.6, -0.9)
    rows = rows_of(np.outer(2.0 * np.sin(t), strong) + np.outer(np.cos(t), weak))
    assert select_qr(rows, 1) == (5,)
    assert select_qr(rows, 1, modes=2) == (8,)
    # A basis smaller than the budget grows to it.
    assert select_qr(rows, 2, modes=1) == select_qr(rows, 2)
