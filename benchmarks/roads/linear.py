"""The linear controller of `stillwake identify`, through bus and ECU like the release.

Identified with its defaults from the shipped recording, or from one more episode, recorded under the release; exported
with its C library, and driven as a bundle. Whatever runs here is what `stillwake export` writes.
"""

import time
from dataclasses import asdict
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any, Final

from benchmarks.common.parts import part
from benchmarks.roads.cost import median_step_ms
from benchmarks.roads.loop import Setting, through_can
from benchmarks.roads.release import recorded_periods
from benchmarks.roads.row import Outcome, Row
from contract.config.body_sensors import layout_of
from contract.model import linear_model_folder
from contract.release import bundle as bundles
from contract.runtime.onnx_session import OnnxController
from contract.shipped import BUNDLE, RECORDING
from export.release.pipeline import CLibrary, export_all
from firmware_sim.ecu.bundle_policy import BundlePolicy
from firmware_sim.in_c.host_library import CController
from firmware_sim.mcu.measure import measure_folder
from train.linear.pipeline import Design, Identification, identify_all
from wake.recording.controlled_plan import ControlledRound
from wake.recording.controlled_recording import record_round
from wake.truck.state import State

UNDER_RELEASE: Final = "linear-under-release"
HOW: Final = {
    "linear": Identification(),
    # The way down to the plateau is part of what the controller has to know: only the first 30 t_c are left out.
    UNDER_RELEASE: Identification(leave_out=150, held_out=0.1),
}
WEIGHTS: Final = Design()
STEPS: Final = 2000
"""Steps of the episode under the release, 400 t_c, with the usual exploration."""


def measure(road: str, setting: Setting) -> Row:
    """Its row."""
    made = part(setting.folder / "identified.json", lambda: _made(road, setting))
    release = bundles.load(setting.folder / "bundle")
    sizes = release.manifest.sizes

    def run(start: State) -> Outcome:
        return through_can(release, setting.config, start)

    core = part(setting.folder / "cortex_m7.json", lambda: asdict(measure_folder(setting.folder / "c")))
    return Row(
        road=road,
        title="linear model and regulator" + (", data under the release" if road == UNDER_RELEASE else ""),
        kind="linear",
        outcomes=setting.outcomes(run),
        sensors=sizes.sensors,
        loop="CAN",
        mesh=setting.mesh,
        interactions=recorded_periods() + (STEPS if road == UNDER_RELEASE else 0),
        training_minutes=made["minutes"],
        step_ms=part(setting.folder / "step_ms.json", lambda: median_step_ms(OnnxController.of(release), sizes)),
        m7_ms=core["modelled_ms"]["480"],
        note=(f"of {STEPS:,} periods; " if road == UNDER_RELEASE else "")
        + f"memory {sizes.window}, horizon {sizes.horizon}, {core['multiply_accumulates']:,} products a step",
    )


def _recorded(setting: Setting) -> Path:
    """An episode under the release, with exploration."""
    release = bundles.load(BUNDLE)
    path = setting.folder / "recording.h5"
    if not path.exists():
        record_round(
            path,
            ControlledRound(episodes=1, steps=STEPS, bundle=release.manifest.name, bundle_digest=release.digest),
            setting.config,
            partial(BundlePolicy, release, layout=layout_of(setting.config.body)),
        )
    return path


def _made(road: str, setting: Setting) -> dict[str, Any]:
    """Model, bundle and C library in the road's folder, and the minutes that the model took."""
    folder = setting.folder
    recording = _recorded(setting) if road == UNDER_RELEASE else RECORDING
    began = time.process_time()
    identify_all(recording, folder / "model", setting.config, HOW[road], WEIGHTS)
    minutes = (time.process_time() - began) / 60.0
    export_all(
        folder / "model",
        folder / "bundle",
        name="linear",
        recording=recording,
        config=linear_model_folder.read(folder / "model").description.config,
        created=date.today(),
        library=CLibrary(folder=folder / "c", compiled=CController),
    )
    return {"minutes": minutes}
