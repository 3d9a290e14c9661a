"""The linear controller of `stillwake identify` with its defaults, through bus and ECU like the release.

Identified from the shipped recording, exported with its C library, and driven as a bundle. Whatever runs here is what
`stillwake export` writes.
"""

import time
from dataclasses import asdict
from datetime import date
from typing import Any

from benchmarks.common.parts import part
from benchmarks.roads.cost import median_step_ms
from benchmarks.roads.loop import Setting, through_can
from benchmarks.roads.release import recorded_periods
from benchmarks.roads.row import Outcome, Row
from contract import linear_model_folder
from contract.controller.interface import Sizes
from contract.controller.onnx_session import OnnxController
from contract.release import bundle as bundles
from export.release.linear_pipeline import export_linear
from firmware_sim.mcu.measure import measure_folder
from train.linear.pipeline import Design, Identification, identify_all
from wake.shipped import RECORDING
from wake.truck.state import State

HOW = Identification()
WEIGHTS = Design()


def measure(road: str, setting: Setting) -> Row:
    """Its row."""
    made = part(setting.folder / "identified.json", lambda: _made(setting))
    release = bundles.load(setting.folder / "bundle")
    sizes = Sizes.of(release.manifest)

    def run(start: State) -> Outcome:
        return through_can(release, setting.config, start)

    core = part(setting.folder / "cortex_m7.json", lambda: asdict(measure_folder(setting.folder / "c")))
    return Row(
        road=road,
        title="linear model and regulator",
        kind="linear",
        outcomes=setting.outcomes(run),
        sensors=sizes.sensors,
        loop="CAN",
        mesh=setting.mesh,
        interactions=recorded_periods(),
        training_minutes=made["minutes"],
        step_ms=part(setting.folder / "step_ms.json", lambda: median_step_ms(OnnxController.of(release), sizes)),
        m7_ms=core["modelled_ms"]["480"],
        note=f"memory {sizes.window}, horizon {sizes.horizon}, {core['multiply_accumulates']:,} products a step",
    )


def _made(setting: Setting) -> dict[str, Any]:
    """Model, bundle and C library in the road's folder, and the minutes that the model took."""
    folder = setting.folder
    began = time.process_time()
    identify_all(RECORDING, folder / "model", setting.config, HOW, WEIGHTS)
    minutes = (time.process_time() - began) / 60.0
    export_linear(
        folder / "model",
        folder / "bundle",
        name="linear",
        recording=RECORDING,
        config=linear_model_folder.read(folder / "model").description.config,
        c_folder=folder / "c",
        created=date.today(),
    )
    return {"minutes": minutes}
