"""The shipped release, untouched: what `python -m benchmarks release-loop` measured over the same time."""

from typing import Final

from benchmarks.common.commands import ROOT
from benchmarks.common.markdown import read
from benchmarks.common.parts import part
from benchmarks.roads.cost import median_step_ms
from benchmarks.roads.loop import SPANS, Setting
from benchmarks.roads.row import Outcome, Row
from contract.errors import StillwakeError
from contract.recording import dataset
from contract.release import bundle as bundles
from contract.runtime.onnx_session import OnnxController
from contract.shipped import BUNDLE, RECORDING
from wake.solver.grid import box_grid

LOOP: Final = ROOT / "results" / "release_loop.json"


def measure(road: str, setting: Setting) -> Row:
    """Its row."""
    release = bundles.load(BUNDLE)
    sizes = release.manifest.sizes
    return Row(
        road=road,
        title="release: MPC on a learned model",
        kind="learned",
        outcomes=_outcomes(),
        sensors=sizes.sensors,
        loop="CAN",
        mesh=box_grid(setting.config.body.length).shape,
        interactions=recorded_periods(),
        training_minutes=None,
        step_ms=part(setting.folder / "step_ms.json", lambda: median_step_ms(OnnxController.of(release), sizes)),
        m7_ms=read(ROOT / "results" / "operations.json")["figures"]["encoder"]["step_ms_480"],
        note=f"{release.manifest.name}, int8, horizon {release.manifest.mpc.horizon}",
    )


def _outcomes() -> tuple[Outcome, ...]:
    found = read(LOOP)
    spans = tuple(found["facts"][name] for name in ("lead_in", "controlled", "settle"))
    if spans != (SPANS.lead_in, SPANS.controlled, SPANS.settle):
        raise StillwakeError(
            f"{LOOP.name}: is over {spans} t_c, the table over {SPANS.lead_in, SPANS.controlled, SPANS.settle}: "
            f"`python -m benchmarks release-loop --json results/{LOOP.name}` makes it again"
        )
    return tuple(
        Outcome(
            Cd_uncontrolled=one["Cd_uncontrolled"],
            Cd_net_uncontrolled=one["Cd_net_uncontrolled"],
            Cd=one["Cd_controlled"],
            Cd_net=one["Cd_net_controlled"],
            abs_Cl=one["abs_Cl_controlled"],
            mean_Cl=one["mean_Cl_controlled"],
            rms_action=one["rms_action"],
            jet_power=one["jet_power_controlled"],
            trouble=one["trouble"],
        )
        for one in found["figures"]["phases"]
    )


def recorded_periods() -> int:
    """Control periods in the shipped recording."""
    return sum(len(episode) for episode in dataset.read(RECORDING).episodes)
