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


def test_pivots_are_the_peaks_of_disjoint_modes():
    # Three modes on disjoint sensors, each largest at its peak, with amplitudes that do not correlate.
    modes = np.zeros((sensors.COUNT, 3))
    for number, peak in enumerate(PEAKS):
        modes[[peak - 1, peak, peak + 1], number] = 1.0, 2.0, 1.0
    t = 2 * np.pi * np.arange(400) / 400
    rows = rows_of(np.column_stack([3.0 * np.sin(t), 2.0 * np.cos(2 * t), np.sin(5 * t)]) @ modes.T)
    for count in (1, 2, 3):
        assert set(select_qr(rows, count)) == set(PEAKS[:count])
    # Sensors 10 and 11 hear the same amplitude, 70 another at half the strength: QR takes one of the two, then 70.
    pressure = np.zeros((400, sensors.COUNT))
    pressure[:, 10] = pressure[:, 11] = np.sin(t)
    pressure[:, 70] = 0.5 * np.cos(t)
    first, second = select_qr(rows_of(pressure), 2)
    assert {first, second} in ({10, 70}, {11, 70})
    # More modes than sensors: 5 is largest in the strong mode, 8 has the longest row, 0.36 / 2.17 + 0.81 / 1.17.
    strong, weak = np.zeros(sensors.COUNT), np.zeros(sensors.COUNT)
    strong[[5, 6, 8]], weak[[6, 8]] = (1.0, 0.9, 0.6), (0.6, -0.9)
    rows = rows_of(np.outer(2.0 * np.sin(t), strong) + np.outer(np.cos(t), weak))
    assert select_qr(rows, 1) == (5,)
    assert select_qr(rows, 1, modes=2) == (8,)
    # A basis smaller than the budget grows to it.
    assert select_qr(rows, 2, modes=1) == select_qr(rows, 2)
