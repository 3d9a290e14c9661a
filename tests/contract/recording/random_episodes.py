"""Episodes of the truck with random series."""

from typing import Any

import numpy as np

from contract import sensors
from contract.recording.dataset import UNITS, Episode, Role

FACTS = {"flow": {"reynolds": 500.0, "substeps": 30}, "grid": [443, 164]}
"""In the provenance of each."""


def episode(name: str = "first", steps: int = 12, role: Role = "train", **changes: Any) -> Episode:
    rng = np.random.default_rng(steps)
    series = {field: rng.normal(scale=0.2, size=steps) for field in UNITS}
    series["t"] = 0.2 * np.arange(steps, dtype=np.float64)
    series["Cp"] = rng.normal(scale=0.5, size=(steps, sensors.COUNT))
    series |= changes.pop("series", {})
    fields: dict[str, Any] = {"initial_action": 0.01, "provenance": {**FACTS, "seed": 3}, **changes}
    return Episode(name=name, role=role, series=series, **fields)
