"""The command that tunes the optimiser's settings of a release on the live wake."""

import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import date
from math import ceil, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.progress import Progress, TaskID
from rich.table import Table

from contract.config.controller import MpcConfig
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.errors import ConfigError
from contract.release.bundle import Bundle
from contract.results import versions, write_result
from stillwake.outputs import check_json
from stillwake.releases import Trust, describe, open_release
from stillwake.settings import settings
from stillwake.shipped import BUNDLE
from stillwake.stopping import go_on_with
from stillwake.terminal import ConfigFile, JsonFile, Overrides, console, progress_bar
from wake.shipped import model as shipped_model
from wake.shipped import recording

if TYPE_CHECKING:
    import optuna
    from optuna.trial import FrozenTrial

    from firmware_sim.bench.spans import Spans
    from firmware_sim.tuning.judgement import Judged
    from firmware_sim.tuning.score import Goal
    from firmware_sim.tuning.search import Plan
    from stillwake.tuned_release import ModelOf

_USES: Final = ("operating_point", "flow", "bus", "ecu", "vehicle")
_SEARCH: Final = {"lead_in": 10.0, "controlled": 75.0, "settle": 45.0}
"""The side force takes 40 t_c to calm down."""
_JUDGEMENT: Final = {"lead_in": 25.0, "controlled": 100.0, "settle": 40.0}
"""As `stillwake run`."""
_STABLE: Final = 2 / 3
"""Of the default time steps, where the cells grow with the time step: `python -m benchmarks live-speed` has both."""
_SHOWN: Final = 8
"""Trials in the table."""
RESULT: Final = "tuning.json"
FIGURE: Final = "tuning.png"
TUNED: Final = "bundle"


@dataclass(frozen=True, kw_only=True)
class _Place:
    """The folder of a search."""

    path: Path

    def start(self, refinement: float) -> Path:
        return self.path / "starts" / f"mesh_{refinement:g}"

    @property
    def judged(self) -> Path:
        return self.path / "judged"


def tune(
    output: Annotated[Path, typer.Argument(help="Folder to write; a search that was stopped there goes on.")],
    hours: Annotated[
        float, typer.Option(help="For the search, all calls together; the judgement comes after it.")
    ] = 1.0,
    bundle: Annotated[Path | None, typer.Option(help="Release bundle to tune; default: the shipped one.")] = None,
    trust: Trust = None,
    model: Annotated[
        Path | None,
        typer.Option(
            help="Model that the bundle was exported from; without it only weights are tuned. Default: the shipped "
            "one for the shipped bundle."
        ),
    ] = None,
    dataset: Annotated[
        Path | None, typer.Option(help="Data set that the model was fitted to. Default: the shipped recording.")
    ] = None,
    vary: Annotated[
        list[str],
        typer.Option(help="Tune this setting, e.g. lift (repeatable); default: all that can be.", metavar="NAME"),
    ] = [],  # noqa: B006  (typer reads it, nothing writes it)
    phases: Annotated[int, typer.Option(help="Starts of a trial, equal parts of a shedding cycle apart.", min=1)] = 3,
    refinement: Annotated[float, typer.Option(help="flow.refinement of the search; the judgement's is --set's.")] = 0.7,
    lift_bound: Annotated[float, typer.Option(help="Mean |Cl| above which side force costs points.")] = 0.2,
    lift_penalty: Annotated[float, typer.Option(help="Points for a unit of mean |Cl| above the bound.")] = 100.0,
    trials: Annotated[int | None, typer.Option(help="End the search after so many trials, too.", min=1)] = None,
    judged_phases: Annotated[
        int, typer.Option(help="Untuned starts that the winner is judged on; 0: no judgement.", min=0, max=25)
    ] = 5,
    seed: Annotated[int, typer.Option(help="Of what is proposed.", min=0)] = 0,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace another search in the folder.")] = False,
    json_file: JsonFile = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Tune the cost weights, the learning rate and the horizon of a release in the closed loop, on the live wake.

    A trial runs the loop through CAN from several starts, on a coarse mesh.
    Its score is the mean drag reduction in percentage points, less a penalty
    for side force. Trials that fall behind are given up early. The first one
    has the present settings. The winner is then judged beside them, on the
    mesh of --set and from other starts.

    It can be stopped at any time: the same command goes on. Give more --hours
    to a finished search to extend it.
    """
    from firmware_sim.tuning.loop import blocks_in
    from firmware_sim.tuning.score import Goal
    from firmware_sim.tuning.search import JOURNAL, Plan, check_place, complete, open_study, score_of, settings_of
    from firmware_sim.tuning.space import chosen, with_values
    from stillwake.tuned_release import ModelOf

    if not (isfinite(hours) and hours > 0.0):
        raise ConfigError(f"--hours {hours}: must be a number above 0")
    goal = Goal(lift_bound=lift_bound, lift_penalty=lift_penalty)
    check_place(output)
    check_json(json_file)
    config = settings("tune", config_file, overrides, uses=_USES).config
    coarse = replace(config, flow=_coarse(config.flow, refinement))
    release = open_release(bundle, trust)
    if model is None and bundle is None:
        model = shipped_model()
    source = None if model is None else ModelOf.read(model, recording() if dataset is None else dataset, release)
    names = chosen(vary, weights_only=source is None)
    present = release.manifest.mpc
    _check_vehicle(release, config)
    plan = Plan(
        present=present,
        names=names,
        phases=phases,
        blocks=blocks_in(_SEARCH["controlled"]),
        goal=goal,
        seed=seed,
        seconds=3600.0 * hours,
        trials=trials,
    )
    label = _label(plan, release, coarse)
    if overwrite and (output / JOURNAL).is_file():
        _clear(output, label)
    study = open_study(output, label)
    console.print(*describe(release), sep="\n", soft_wrap=True)
    if source is None:
        console.print("no model: only weights are tuned; the bundle's graph fixes learning rate and horizon")
    place = _Place(path=output)
    with go_on_with(f"{output} keeps the finished trials, the same command continues it"):
        _searched(study, plan, release, coarse, source, place)
        best = complete(study)[0]
        winner = None if best.number == 0 else with_values(present, settings_of(best))
        judged = _judged(release, present, winner, source, config, goal, place, judged_phases)
    _print_trials(study, names)
    text = _print_judged(judged, winner, goal)
    figures = _figures(study, plan, winner, judged, text)
    facts = {**label, "versions": versions("stillwake", "optuna", "onnxruntime", "numpy", "numba")}
    for file in (output / RESULT, json_file):
        if file is not None:
            write_result(file, figures=figures, facts=facts, on=date.today())

    from firmware_sim.tuning.figures import write_figure
    from firmware_sim.tuning.search import finished

    write_figure(output / FIGURE, finished(study), figures["importances"])
    console.print(f"best of {len(figures['trials'])} trials: {score_of(best):.2f} points; {text}", soft_wrap=True)
    if winner is not None:
        console.print(_command(bundle, model, present, winner), soft_wrap=True, markup=False, highlight=False)
    console.print(f"wrote {output / RESULT} and {output / FIGURE}", soft_wrap=True, markup=False)


def _coarse(flow: FlowConfig, refinement: float) -> FlowConfig:
    """The flow on the mesh of the search: on a coarser one, with as few time steps as stay stable there."""
    substeps = flow.substeps if refinement >= flow.refinement else ceil(_STABLE * flow.substeps * refinement)
    return replace(flow, refinement=refinement, substeps=substeps)


def _spans(lengths: Mapping[str, float]) -> "Spans":
    from firmware_sim.bench.spans import Spans

    return Spans(lead_in=lengths["lead_in"], controlled=lengths["controlled"], settle=lengths["settle"])


def _check_vehicle(release: Bundle, config: Config) -> None:
    """What a run would refuse is refused before the search."""
    from contract.body_sensors import layout_of
    from firmware_sim.ecu.fit import check_flow, check_sensors, check_vehicle

    check_flow(release, config.flow)
    check_sensors(release, layout_of(config.body))
    check_vehicle(release, config)


def _label(plan: "Plan", release: Bundle, coarse: Config) -> dict[str, Any]:
    """What a search is of: a call with another one is refused in its folder. Its length is no part of it."""
    from contract.config.loading import to_tree

    used = to_tree(coarse)
    return {
        "bundle": release.manifest.name,
        "digest": release.digest,
        "present": asdict(plan.present),
        "vary": list(plan.names),
        "phases": plan.phases,
        "spans": _SEARCH,
        "goal": asdict(plan.goal),
        "seed": plan.seed,
        "settings": {name: used[name] for name in _USES},
    }


def _clear(output: Path, label: Mapping[str, Any]) -> None:
    """Remove a search of something else; one of the same is gone on with."""
    from contract.errors import OutputError
    from firmware_sim.tuning.search import JOURNAL, open_study

    try:
        open_study(output, label)
    except OutputError:
        for folder in ("starts", "judged", TUNED):
            shutil.rmtree(output / folder, ignore_errors=True)
        for file in (JOURNAL, RESULT, FIGURE):
            (output / file).unlink(missing_ok=True)


def _searched(
    study: "optuna.Study", plan: "Plan", release: Bundle, coarse: Config, source: "ModelOf | None", place: _Place
) -> None:
    """Make the trials, with progress in minutes of the budget."""
    from firmware_sim.tuning.loop import Report, WakeRuns
    from firmware_sim.tuning.score import PhaseFigures
    from firmware_sim.tuning.search import complete, finished, score_of, search, spent
    from firmware_sim.tuning.starts import phases_between, starts_at
    from stillwake.tuned_release import controller_of

    made = finished(study)
    if made and (spent(study) >= plan.seconds or (plan.trials is not None and len(made) >= plan.trials)):
        return
    with progress_bar("min", estimate_over=3600.0) as bar:
        task = bar.add_task("search", total=round(plan.seconds / 60.0, 1), note="")

        def settle(t: float, total: float) -> None:
            bar.update(task, completed=0, note=f"the wake settles on the coarse mesh: {t:.0f} of {total:.0f} t_c")

        bar.update(task, completed=0, note="preparing the starts")
        periods = phases_between(plan.phases, coarse.flow.control_period)
        runs = WakeRuns(
            release,
            coarse,
            starts=starts_at(place.start(coarse.flow.refinement), coarse, periods, settle),
            spans=_spans(_SEARCH),
            goal=plan.goal,
            controller=controller_of(release, source),
        )
        before, since = spent(study), time.monotonic()
        current = [len(made)]

        def begun(number: int) -> None:
            current[0] = number

        def run(mpc: MpcConfig, phase: int, report: Report) -> PhaseFigures:
            best = complete(study)
            reached = f", best {score_of(best[0]):.2f}" if best else ""

            def show(done: int, total: int) -> None:
                minutes = (before + time.monotonic() - since) / 60.0
                note = f"trial {current[0]}, run {phase + 1} of {plan.phases}{reached}"
                bar.update(task, completed=min(round(minutes, 1), round(plan.seconds / 60.0, 1)), note=note)

            return runs(mpc, phase, report, show)

        search(study, plan, run, clock=time.monotonic, begun=begun)
        bar.update(task, completed=round(plan.seconds / 60.0, 1), note="")


def _judged(
    release: Bundle,
    present: MpcConfig,
    winner: MpcConfig | None,
    source: "ModelOf | None",
    config: Config,
    goal: "Goal",
    place: _Place,
    phases: int,
) -> "list[Judged]":
    """The present settings and the winner's, on the mesh of the settings, from starts that nothing was tuned on."""
    if phases == 0:
        return []
    from contract.controller.onnx_session import OnnxController
    from firmware_sim.campaign.starts import phases_apart
    from firmware_sim.tuning.judgement import Candidate, judge
    from firmware_sim.tuning.loop import WakeRuns
    from firmware_sim.tuning.score import PhaseFigures
    from firmware_sim.tuning.starts import starts_at
    from stillwake.tuned_release import release_of

    spans = _spans(_JUDGEMENT)
    _, total = spans.periods(config.flow.control_period)
    found = list["Judged"]()
    with progress_bar("periods", estimate_over=3600.0) as bar:
        task: TaskID = bar.add_task("judgement", total=total * phases * (1 if winner is None else 2), note="")
        bar.update(task, completed=0, note="preparing the starts")
        times = phases_apart(phases, config.flow.control_period)
        starts = starts_at(place.start(config.flow.refinement), config, times, lambda t, whole: _tick(bar, task))
        for name, mpc in (("present", present), ("best", winner)):
            if mpc is None:
                continue
            made = release_of(release, mpc, source, place.path / TUNED, date.today())
            runs = WakeRuns(
                made,
                config,
                starts=starts,
                spans=spans,
                goal=goal,
                controller=lambda _, made=made: OnnxController.of(made),  # type: ignore[misc]
            )
            before = len(found) * phases * total

            def run(mpc: MpcConfig, phase: int, runs: WakeRuns = runs, before: int = before) -> PhaseFigures:
                def show(done: int, _total: int) -> None:
                    note = f"{name}, run {phase + 1} of {phases}"  # noqa: B023  (called within this turn)
                    bar.update(task, completed=before + phase * total + done, note=note)

                return runs(mpc, phase, lambda block, score: None, show)

            def done(phase: int, before: int = before) -> None:
                bar.update(task, completed=before + (phase + 1) * total)

            candidate = Candidate(name=name, mpc=mpc, digest=made.manifest.program_sha256)
            found.append(judge(place.judged, candidate, phases, run, done))
        bar.update(task, note="")
    return found


def _tick(bar: Progress, task: TaskID) -> None:
    bar.update(task, note="the wake settles on the mesh")


def _figures(
    study: "optuna.Study", plan: "Plan", winner: MpcConfig | None, judged: "Sequence[Judged]", text: str
) -> dict[str, Any]:
    from firmware_sim.tuning.judgement import is_clearly_better, to_tree
    from firmware_sim.tuning.search import PHASES, SECONDS, SETTINGS, finished, importances, spent

    return {
        "trials": [
            {
                "score": trial.value if trial.state.name == "COMPLETE" else None,
                "given_up": trial.state.name == "PRUNED",
                **{name: trial.user_attrs.get(name) for name in (SETTINGS, PHASES, SECONDS)},
            }
            for trial in finished(study)
        ],
        "search_hours": spent(study) / 3600.0,
        "importances": importances(study, plan.seed),
        "best": None if winner is None else asdict(winner),
        "judged": to_tree(judged),
        "clearly_better": len(judged) == 2 and is_clearly_better(judged[1], judged[0], plan.goal),
        "verdict": text,
    }


def _print_trials(study: "optuna.Study", names: Sequence[str]) -> None:
    from firmware_sim.tuning.search import PHASES, complete, finished, score_of, settings_of

    made = finished(study)
    numbers = {trial.number: k for k, trial in enumerate(made)}
    best = complete(study)
    shown = best[:_SHOWN]
    present: list[FrozenTrial] = [trial for trial in best[_SHOWN:] if numbers[trial.number] == 0]
    table = Table("trial", "score", "mean |Cl|", *(name.rpartition(".")[2] for name in names))
    for trial in (*shown, *present):
        number = numbers[trial.number]
        lifts = [run["abs_Cl"] for run in trial.user_attrs[PHASES] if run["abs_Cl"] is not None]
        table.add_row(
            f"{number} (present)" if number == 0 else str(number),
            f"{score_of(trial):.2f}",
            f"{sum(lifts) / len(lifts):.3f}" if lifts else "",
            *(f"{settings_of(trial)[name]:g}" for name in names),
        )
    console.print(table)
    console.print(f"{len(made)} trials, {len(made) - len(best)} of them given up early")


def _print_judged(judged: "Sequence[Judged]", winner: MpcConfig | None, goal: "Goal") -> str:
    """The table of the judgement; what it says, in words."""
    from firmware_sim.tuning.judgement import verdict

    if not judged:
        return "not judged"
    table = Table(
        "judged", "less drag, %", "least .. most", "mean |Cl|", "most", "less Cd_net, %", "rms action", "jets"
    )
    for one in judged:
        spreads = {
            name: one.spread(name)
            for name in ("reduction_percent", "abs_Cl", "Cd_net_reduction_percent", "rms_action", "jet_power")
        }
        mean, least, most = spreads["reduction_percent"]
        table.add_row(
            one.candidate.name,
            f"{mean:.2f}",
            f"{least:.2f} .. {most:.2f}",
            f"{spreads['abs_Cl'][0]:.3f}",
            f"{spreads['abs_Cl'][2]:.3f}",
            f"{spreads['Cd_net_reduction_percent'][0]:.2f}",
            f"{spreads['rms_action'][0]:.4f}",
            f"{spreads['jet_power'][0]:.4f}",
        )
    console.print(table)
    return verdict(judged[1] if winner is not None else None, judged[0], goal)


def _command(bundle: Path | None, model: Path | None, present: MpcConfig, winner: MpcConfig) -> str:
    """What makes a signed bundle with the winner's settings."""
    from firmware_sim.tuning.space import changed, is_weight

    new = changed(present, winner)
    sets = " ".join(f"--set {name}={value:g}" for name, value in new.items())
    if all(map(is_weight, new)):
        release = BUNDLE if bundle is None else bundle
        return f"a bundle of it: stillwake bundle renew {release} NEW --name NAME --key release.key {sets}"
    return f"a bundle of it: stillwake export {model} NEW --sensors --name NAME --key release.key {sets}"
