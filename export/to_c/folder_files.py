"""The other files of a C library's folder: documents, and the answers that its example must give."""

from collections.abc import Mapping, Sequence
from importlib.resources import files

import numpy as np

from contract.arrays import Array
from contract.controller.c_folder import DOCUMENTS, Settings
from contract.controller.interface import FORCES, TERMS, Controller

_FLOAT_BYTES = 4


def documents(library: Mapping[str, bytes]) -> dict[str, bytes]:
    """README, rules for CMake and licence, with the sizes of this library filled in."""
    root = files("export.to_c").joinpath("folder")
    found = {name: root.joinpath(name).read_bytes() for name in DOCUMENTS}
    text = found["README.md"].decode("utf-8")
    for name, value in _facts(Settings.of(library)).items():
        text = text.replace(f"@{name}@", str(value))
    return {**found, "README.md": text.encode("utf-8")}


def replay(controller: Controller, windows: Sequence[Array], horizon: int) -> Array:
    """What the example program expects, (n, 4): the planned action, the predicted mean Cd and Cl, and the cost.

    Every answer starts from a plan of zeros. Were a plan to go into the next step, a difference in rounding could grow
    from answer to answer, and more with one plant than with another.

    Args:
        windows: n windows (L, S+1), each a control step after the other.
    """
    plan, free = np.zeros(horizon), np.ones(horizon)
    steps = [controller.control_step(window, plan, free) for window in windows]
    return np.array([[step.plan[0], *step.forces.mean(axis=0), step.cost] for step in steps])


def _facts(settings: Settings) -> dict[str, str | int]:
    window, sensors, horizon = (settings.number(f"SW_{name}") for name in ("WINDOW", "SENSORS", "HORIZON"))
    return {
        "PRECISION": settings.text("SW_PRECISION"),
        "WINDOW": window,
        "SENSORS": sensors,
        "SENSOR_NAMES": settings.text("SW_SENSOR_NAMES"),
        "HORIZON": horizon,
        "ITERATIONS": settings.number("SW_ITERATIONS"),
        "PROGRAM": settings.text("SW_PROGRAM_SHA256"),
        "INPUT_BYTES": _FLOAT_BYTES * (window * (sensors + 1) + 2 * horizon + len(TERMS) + 2),
        "OUTPUT_BYTES": _FLOAT_BYTES * (horizon * (1 + FORCES) + len(TERMS) + 1),
        "PRODUCTS": f"{settings.multiply_accumulates():,}",
    }
