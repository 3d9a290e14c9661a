"""The command that tunes the optimiser's settings of a release on the live wake."""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from datetime import date
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.table import Table

from contract.atomic import check_writable
from contract.config.controller import MpcConfig
from contract.config.tree import Config
from contract.errors import ConfigError
from contract.release.checks import Bundle
from contract.results import versions, write_result
from contract.shipped import BUNDLE, recording
from contract.shipped import model as shipped_model
from stillwake.console.outputs import check_json
from stillwake.console.settings import settings
from stillwake.console.stopping import go_on_with
from stillwake.console.terminal import ConfigFile, JsonFile, Overrides, console
from stillwake.parts.releases import Trust, describe, open_release
from stillwake.parts.tuning import SEARCH, TUNED, coarse_flow, judged, searched, spans_of

if TYPE_CHECKING:
    import optuna
    from optuna.trial import FrozenTrial

    from firmware_sim.tuning.judgement import Judged
    from firmware_sim.tuning.score import Goal
    from firmware_sim.tuning.search import Plan

_USES: Final = ("operating_point", "flow", "bus", "ecu", "vehicle")
_LONGEST: Final = 1e4
"""Hours: a year."""
_SHOWN: Final = 8
"""Trials in the table."""
RESULT: Final = "tuning.json"
FIGURE: Final = "tuning.png"


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
    tries: Annotated[
        list[str],
        typer.Option(
            "--try", help="Try these settings first, e.g. lift=0.2,horizon=30 (repeatable).", metavar="NAME=VALUE,.."
        ),
    ] = [],  # noqa: B006
    phases: Annotated[
        int, typer.Option(help="Starts of a trial, equal parts of a shedding cycle apart.", min=1, max=25)
    ] = 3,
    refinement: Annotated[
        float, typer.Option(help="flow.refinement of the search; the judgement's is --set's.")
    ] = 0.75,
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
    has the present settings. The winner is then judged with them, on the
    mesh of --set and from other starts.

    It can be stopped at any time: the same command goes on. Give more --hours
    to a finished search to extend it.
    """
    from firmware_sim.tuning.loop import blocks_in
    from firmware_sim.tuning.score import Goal
    from firmware_sim.tuning.search import (
        JOURNAL,
        Plan,
        check_place,
        complete,
        finished,
        open_study,
        score_of,
        settings_of,
    )
    from firmware_sim.tuning.space import chosen, parsed, with_values
    from stillwake.parts.tuned_release import ModelOf, first_exported

    if not 0.0 < hours <= _LONGEST:
        raise ConfigError(f"--hours {hours}: must be above 0, at most {_LONGEST:g}")
    goal = Goal(lift_bound=lift_bound, lift_penalty=lift_penalty)
    check_writable(output, folder=True)
    check_place(output)
    check_json(json_file)
    config = settings("tune", config_file, overrides, uses=_USES).config
    coarse = replace(config, flow=coarse_flow(config.flow, refinement))
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
        blocks=blocks_in(SEARCH["controlled"]),
        goal=goal,
        seed=seed,
        seconds=3600.0 * hours,
        trials=trials,
        tries=tuple(parsed(text, present, names) for text in tries),
    )
    label = _label(plan, release, coarse)
    if overwrite and (output / JOURNAL).is_file():
        _clear(output, label)
    study = open_study(output, label) if (output / JOURNAL).is_file() else None
    console.print(*describe(release), sep="\n", soft_wrap=True)
    if source is None:
        console.print("no model: only weights are tuned; the bundle's graph fixes learning rate and horizon")
    facts = {**label, "versions": versions("stillwake", "optuna", "onnxruntime", "numpy", "numba")}
    try:
        with go_on_with(f"{output} keeps the finished trials, the same command continues it"):
            study = searched(study, plan, label, release, coarse, source, output)
            order = {trial.number: k for k, trial in enumerate(finished(study))}
            better = {
                order[trial.number]: with_values(present, settings_of(trial))
                for trial in takewhile(lambda trial: order[trial.number] > 0, complete(study))
            }
            if better and source is not None:
                console.print("making the release of the best trial")
            best, skipped = first_exported(release, better, source, output / TUNED, date.today())
            found = judged(release, None if best is None else best[1], config, goal, output, judged_phases)
    except (KeyboardInterrupt, ConfigError) as stop:
        stopped = isinstance(stop, KeyboardInterrupt)
        if stopped or (output / JOURNAL).is_file():
            text = "stopped before there was a judgement; the same command continues" if stopped else str(stop)
            figures = _figures(open_study(output, label), plan, None, {}, [], text)
            write_result(output / RESULT, figures=figures, facts=facts, on=date.today())
        raise
    winner = None if best is None else best[1].manifest.mpc
    _print_trials(study, names)
    text = _print_judged(found, winner, skipped, goal)
    figures = _figures(study, plan, winner, skipped, found, text)
    for file in (output / RESULT, json_file):
        if file is not None:
            write_result(file, figures=figures, facts=facts, on=date.today())

    from firmware_sim.tuning.search_picture import write_figure

    write_figure(output / FIGURE, finished(study), figures["importances"])
    score = score_of(finished(study)[0 if best is None else best[0]])
    console.print(f"best of {len(figures['trials'])} trials: {score:.2f} points; {text}", soft_wrap=True)
    if winner is not None:
        console.print(_command(bundle, model, present, winner), soft_wrap=True, markup=False, highlight=False)
    console.print(f"wrote {output / RESULT} and {output / FIGURE}", soft_wrap=True, markup=False)


def _check_vehicle(release: Bundle, config: Config) -> None:
    """What a run would refuse is refused before the search."""
    from contract.config.body_sensors import layout_of
    from firmware_sim.bench.simulation import Simulation
    from firmware_sim.ecu.fit import check_flow, check_sensors

    check_flow(release, config.flow)
    check_sensors(release, layout_of(config.body))
    Simulation(release, config, spans=spans_of(SEARCH))


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
        "spans": SEARCH,
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


def _figures(
    study: "optuna.Study",
    plan: "Plan",
    winner: MpcConfig | None,
    skipped: Mapping[int, str],
    runs: "Sequence[Judged]",
    text: str,
) -> dict[str, Any]:
    from firmware_sim.tuning.judgement import is_clearly_better, to_tree
    from firmware_sim.tuning.search import PHASES, SECONDS, SETTINGS, finished, importances, spent

    return {
        "trials": [
            {
                "score": trial.value if trial.state.name == "COMPLETE" else None,
                "given_up": trial.state.name == "PRUNED",
                "skipped": skipped.get(k),
                **{name: trial.user_attrs.get(name) for name in (SETTINGS, PHASES, SECONDS)},
            }
            for k, trial in enumerate(finished(study))
        ],
        "search_hours": spent(study) / 3600.0,
        "importances": importances(study, plan.seed),
        "best": None if winner is None else asdict(winner),
        "judged": to_tree(runs),
        "clearly_better": len(runs) == 2 and is_clearly_better(runs[1], runs[0], plan.goal),
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


def _print_judged(runs: "Sequence[Judged]", winner: MpcConfig | None, skipped: Mapping[int, str], goal: "Goal") -> str:
    """The tables of what was skipped and of the judgement, and its verdict in words."""
    from firmware_sim.tuning.judgement import verdict

    if skipped:
        refused = Table("skipped trial", "because its export was refused")
        for number, why in skipped.items():
            refused.add_row(str(number), why)
        console.print(refused)
    if winner is None and skipped:
        return "not better: no settings that scored better than the present ones can be exported"
    if not runs:
        return "not judged"
    table = Table(
        "judged", "less drag, %", "least .. most", "mean |Cl|", "most", "less Cd_net, %", "rms action", "jets"
    )
    for one in runs:
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
    return verdict(runs[1] if winner is not None else None, runs[0], goal)


def _command(bundle: Path | None, model: Path | None, present: MpcConfig, winner: MpcConfig) -> str:
    """What makes a signed bundle with the winner's settings."""
    from firmware_sim.tuning.space import changed, is_weight

    new = changed(present, winner)
    sets = " ".join(f"--set {name}={value:g}" for name, value in new.items())
    if all(map(is_weight, new)):
        release = BUNDLE if bundle is None else bundle
        return f"a bundle of it: stillwake bundle renew {release} NEW --name NAME --key release.key {sets}"
    return f"a bundle of it: stillwake export {model} NEW --sensors --name NAME --key release.key {sets}"
