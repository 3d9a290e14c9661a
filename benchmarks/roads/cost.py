"""What a control step takes: measured here, and modelled on a Cortex-M7."""

import time
from collections.abc import Callable
from typing import Final

import numpy as np

from benchmarks.common.commands import ROOT
from benchmarks.common.markdown import read
from contract.controller.interface import RunnableController, Sizes

STEPS: Final = 300


def median_step_ms(
    controller: RunnableController, sizes: Sizes, clock: Callable[[], float] = time.process_time
) -> float:
    """Median CPU time of a control step on random windows, ms: other work on the machine hardly shows in it."""
    controller.warm_up(10)
    generator, taken = np.random.default_rng(0), []
    plan, free = np.zeros(sizes.horizon), np.ones(sizes.horizon)
    free[0] = 0.0
    for _ in range(STEPS):
        window = 0.1 * generator.standard_normal((sizes.window, sizes.sensors + 1)) - 0.3
        before = clock()
        plan = controller.control_step(window, plan, free).plan
        taken.append(1e3 * (clock() - before))
    return float(np.median(taken))


def m7_ms(products: int) -> float:
    """ms of a step of so many products at 480 MHz: what one takes in an iteration of the release's optimiser.

    A step of few products is dominated by everything else: an estimate from below.
    """
    found = read(ROOT / "results" / "operations.json")
    adam = {row["iterations"]: row for row in found["figures"]["roads"] if row["name"] == "Adam"}
    longer, shorter = adam[3], adam[2]
    per_product = (longer["modelled_ms_480"] - shorter["modelled_ms_480"]) / (
        longer["multiply_accumulates"] - shorter["multiply_accumulates"]
    )
    return float(products * per_product)
