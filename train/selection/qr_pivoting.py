"""Sensors from which the pressure field itself is best rebuilt, whatever the latents hold of it.

QR with column pivoting on the transposed leading POD modes, Manohar, Brunton, Kutz and Brunton, "Data-driven sparse
sensor placement for reconstruction", IEEE Control Systems Magazine 38 (2018), section "Sensor placement for
reconstruction": each pivot is the sensor whose row of the modes is longest after those already chosen are taken out.
"""

import numpy as np
import scipy.linalg

from contract.arrays import Array
from train.samples.rows import Rows

# PyPI's python-sensors 0.4 does this too, but brings scikit-learn, matplotlib and pandas for one call of SciPy's.


def pod_modes(rows: Rows, count: int) -> Array:
    """(N, count) leading modes of the standardised pressures, those of most variance first."""
    pressure = rows.inputs[:, : rows.sensors].cpu().numpy().astype(np.float64)
    pressure -= pressure.mean(axis=0)
    _, vectors = np.linalg.eigh(pressure.T @ pressure)
    return vectors[:, ::-1][:, :count]


def select_qr(rows: Rows, count: int, *, modes: int | None = None) -> tuple[int, ...]:
    """Indices of the first `count` pivots, in their order.

    Args:
        modes: size of the basis; as many as sensors if None or fewer than those, because a basis of r modes
            distinguishes no more than r sensors.
    """
    basis = pod_modes(rows, max(count, modes or 0))
    _, order = scipy.linalg.qr(basis.T, mode="r", pivoting=True)
    return tuple(order[:count].tolist())
