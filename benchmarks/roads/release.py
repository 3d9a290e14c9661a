"""The shipped release, untouched."""

from benchmarks.common.commands import ROOT
from benchmarks.common.markdown import read
from benchmarks.roads.cost import median_step_ms
from benchmarks.roads.loop import Setting, through_can
from benchmarks.roads.row import Outcome, Row
from contract.controller.interface import Sizes
from contract.controller.onnx_session import OnnxController
from contract.recording import dataset
from contract.release import bundle as bundles
from stillwake.shipped import BUNDLE
from wake.shipped import RECORDING
from wake.truck.state import State


def measure(road: str, setting: Setting) -> Row:
    """Its row."""
    release = bundles.load(BUNDLE)
    controller = OnnxController.of(release)

    def run(start: State) -> Outcome:
        return through_can(release, setting.config, start, controller)

    outcomes = setting.outcomes(run)
    return Row(
        road=road,
        title="release: MPC on a learned model",
        kind="learned",
        outcomes=outcomes,
        sensors=len(release.manifest.sensors),
        loop="CAN",
        mesh=setting.mesh,
        interactions=recorded_periods(),
        training_minutes=None,
        step_ms=median_step_ms(controller, Sizes.of(release.manifest)),
        m7_ms=read(ROOT / "results" / "operations.json")["figures"]["encoder"]["step_ms_480"],
        note=f"{release.manifest.name}, int8, horizon {release.manifest.mpc.horizon}",
    )


def recorded_periods() -> int:
    """Control periods in the shipped recording."""
    return sum(len(episode) for episode in dataset.read(RECORDING).episodes)
