"""The two rows that no controller made: the wake as it is, and the steady symmetric one that shedding would leave."""

from dataclasses import replace
from typing import Final

from benchmarks.common.commands import ROOT
from benchmarks.common.markdown import read
from benchmarks.roads.loop import Setting, plant_outcome
from benchmarks.roads.row import Outcome, Row
from contract.errors import StillwakeError
from wake.plant.sample import Sample
from wake.truck.state import State

STEADY: Final = ROOT / "results" / "steady.json"


class NoControl:
    """Commands nothing."""

    def see(self, sample: Sample) -> None:
        """Nothing is remembered."""

    def command(self, committed: float) -> float:
        return 0.0


def measure(road: str, setting: Setting) -> Row:
    """One of the two."""

    def run(start: State) -> Outcome:
        return plant_outcome(setting.config, start, NoControl())

    # Of one wake, which is computed once.
    outcomes = replace(setting, folder=setting.folder.parent).outcomes(run, "no_control")
    title = "no control"
    if road == "steady":
        figures = read(STEADY)["figures"]
        _check(tuple(read(STEADY)["facts"]["grid"]), setting.mesh)
        title = "steady symmetric wake"
        # Jets shut in a symmetric flow: no lift, no action, no power; of the rest only the slots' force is left.
        outcomes = tuple(
            Outcome(
                Cd_uncontrolled=outcome.Cd_uncontrolled,
                Cd_net_uncontrolled=outcome.Cd_net_uncontrolled,
                Cd=figures["Cd"],
                Cd_net=figures["Cd"] + figures["Cd_slot"],
                abs_Cl=0.0,
                mean_Cl=0.0,
                rms_action=0.0,
                jet_power=0.0,
            )
            for outcome in outcomes
        )
    note = {
        "no-control": "what every other row is compared with",
        "steady": "the wake without shedding, from `stillwake steady`: no controller holds it",
    }
    return Row(
        road=road,
        title=title,
        kind="bound",
        outcomes=outcomes,
        sensors=0,
        loop="plant",
        mesh=setting.mesh,
        note=note[road],
    )


def _check(found: tuple[int, ...], wanted: tuple[int, int]) -> None:
    if found != wanted:
        raise StillwakeError(
            f"{STEADY.name}: is of a grid of {found[0]} x {found[1]} cells, the table is of {wanted[0]} x {wanted[1]}: "
            f"`stillwake steady runs/steady.npz --json results/{STEADY.name}` makes it again"
        )
