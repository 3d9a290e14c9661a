"""The command that records: forced episodes, the paper's data set, or a round under a release's controller or from the
steady wake."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import TaskID

from contract.config.body_sensors import layout_of
from contract.config.tree import Config
from contract.errors import StillwakeError
from contract.release.checks import Bundle
from stillwake.console.claims import claim
from stillwake.console.numbers import cores
from stillwake.console.outputs import Overwrite, check_dataset_name, check_output
from stillwake.console.settings import settings
from stillwake.console.stopping import go_on_with
from stillwake.console.terminal import ConfigFile, Overrides, console, progress_bar
from stillwake.parts.releases import describe, open_release

if TYPE_CHECKING:
    from wake.recording.feedback import PolicyFactory


def record(
    output: Annotated[
        Path,
        typer.Argument(help="Data set to write (.h5 or .hdf5); with --under or --from-steady, to add to."),
    ],
    training: Annotated[
        int | None,
        typer.Option(
            help="Control steps of the training waveform, a sine whose frequency and amplitude vary (6000).", min=0
        ),
    ] = None,
    chirp: Annotated[
        int | None,
        typer.Option(help="Control steps of the chirp, a slow sweep of the frequency, to test on (1500).", min=0),
    ] = None,
    uncontrolled: Annotated[int | None, typer.Option(help="Control steps without forcing (500).", min=0)] = None,
    paper: Annotated[
        bool,
        typer.Option(
            "--paper",
            help="The paper's data set instead: 50,000 training steps in ten episodes, 2,500 uncontrolled, 10,000 of "
            "the chirp to test on, and 10,000 of the extended chirp of its appendix A.",
        ),
    ] = False,
    under: Annotated[
        Path | None,
        typer.Option(help="Instead, let this release bundle's controller drive the jets, and add the episodes."),
    ] = None,
    controlled: Annotated[
        int | None, typer.Option(help="With --under: control steps an episode (1100).", min=1)
    ] = None,
    from_steady: Annotated[
        Path | None,
        typer.Option(
            "--from-steady",
            help="Instead, begin at the steady symmetric wake of this file (.npz, from `steady`; computed and written "
            "there if there is none) under small random actions, and add the episodes. With --under, the controller "
            "acts as well.",
        ),
    ] = None,
    calm: Annotated[int | None, typer.Option(help="With --from-steady: control steps an episode (350).", min=1)] = None,
    amplitudes: Annotated[
        tuple[float, float] | None,
        typer.Option(
            help="With --from-steady: smallest and largest rms of the random action, in U_inf W; the episodes lie "
            "between them, evenly by the logarithm (0.0005 0.02).",
        ),
    ] = None,
    episodes: Annotated[
        int | None, typer.Option(help="With --under: episodes (2); with --from-steady (8).", min=1)
    ] = None,
    exploration: Annotated[
        float | None,
        typer.Option(help="With --under: rms of the noise added to the commands, in action limits (0.15)."),
    ] = None,
    role: Annotated[
        str | None,
        typer.Option(
            help="With --under: train, or controlled to hold the episodes out (train); with --from-steady, train or "
            "calm."
        ),
    ] = None,
    seed: Annotated[
        int,
        typer.Option(
            help="Seed of the training waveform; with --paper, of the first of its ten episodes, and the others count "
            "on from it; with --under, of the exploration and of where episodes begin; with --from-steady, of the "
            "random actions.",
            min=0,
        ),
    ] = 1,
    start: Annotated[
        Path | None,
        typer.Option(help="Flow state in which episodes begin (.npz, from `develop`); default: the shipped start."),
    ] = None,
    overwrite: Overwrite = False,
    workers: Annotated[
        int | None, typer.Option(help="Processes, an episode each at a time; default: one a core.", min=1)
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(help="Record on this dask scheduler's workers; they must have the output's folder at its path."),
    ] = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006  (typer reads it, nothing writes it)
) -> None:
    """Record the forced wake at every control step: pressures at all sensors, drag and side force.

    With --under, record it under a controller with exploration, and add the
    episodes. With --from-steady, record how small disturbances grow on the
    steady wake, with or without a controller. It can be stopped at any time.
    The same command continues where it was, and leaves a finished recording
    as it is.
    """
    is_forced = under is None and from_steady is None
    uses = ("body", "flow", "forcing" if is_forced else "forcing.exploration_time")
    config = settings("record", config_file, overrides, uses=uses).config
    claim(output)
    check_dataset_name(output)
    lengths = {"training": training, "chirp": chirp, "uncontrolled": uncontrolled}
    of_controlled = {"controlled": controlled, "exploration": exploration}
    of_calm = {"calm": calm, "amplitudes": amplitudes}
    of_round: dict[str, Any] = {"episodes": episodes, "role": role}
    how = {"workers": cores() if workers is None else workers, "scheduler": scheduler, "start": start}
    if from_steady is None:
        _refuse_given(of_calm, "is of episodes from the steady wake: give --from-steady FILE as well")
    if is_forced:
        _refuse_given(of_controlled, "needs a controller: give --under BUNDLE as well")
        _refuse_given(of_round, "needs a controller or the steady wake: give --under or --from-steady as well")
        if paper:
            _refuse_given(lengths, "does not go with --paper, which has its own lengths")
        _record_forced(output, config, None if paper else _given(lengths), seed, {**how, "overwrite": overwrite})
        return
    option, steps = ("--under", "--controlled") if from_steady is None else ("--from-steady", "--calm")
    if paper:
        raise StillwakeError(f"{option} and --paper are two recordings: give one of them")
    if overwrite:
        raise StillwakeError(f"--overwrite does not go with {option}, which adds a round and replaces nothing")
    _refuse_given(lengths, f"does not go with {option}: give {steps} and --episodes instead")
    of_plan = {**of_round, "seed": seed, "steps": controlled, "exploration": exploration}
    if from_steady is not None:
        _refuse_given(of_controlled, "does not go with --from-steady: give --calm and --amplitudes instead")
        _refuse_given({"start": start}, "does not go with --from-steady, which names where episodes begin")
        smallest, largest = (None, None) if amplitudes is None else amplitudes
        of_plan |= {"steps": calm, "smallest": smallest, "largest": largest}
    _record_round(output, config, from_steady, under, _given(of_plan), how)


def _record_forced(
    output: Path, config: Config, lengths: Mapping[str, int] | None, seed: int, how: Mapping[str, Any]
) -> None:
    """Episodes of these lengths, in control steps; None: the paper's."""
    from wake.recording.episode_plan import EpisodePlan, paper_plans
    from wake.recording.recorder import record as record_dataset

    if lengths is None:
        plans = paper_plans(seed)
    else:
        steps = {"training": 6000, "chirp": 1500, "uncontrolled": 500, **lengths}
        plans = (
            EpisodePlan(forcing="training", steps=steps["training"], seed=seed),
            EpisodePlan(forcing="chirp", steps=steps["chirp"], seed=0),
            EpisodePlan(forcing="none", steps=steps["uncontrolled"], seed=0),
        )
    plans = tuple(plan for plan in plans if plan.steps > 0)
    if not plans:
        raise StillwakeError("nothing to record: give at least one of --training, --chirp, --uncontrolled")
    with _continued(output), _progress(len(plans)) as shown:
        written = record_dataset(output, plans, config, **how, **shown)
    total = sum(plan.steps for plan in plans)
    done = "wrote" if written else "already whole, nothing to record:"
    console.print(f"{done} {output}: {total} control steps, {output.stat().st_size / 1e6:.1f} MB")


def _record_round(
    output: Path,
    config: Config,
    steady: Path | None,
    bundle: Path | None,
    of_plan: Mapping[str, Any],
    how: Mapping[str, Any],
) -> None:
    """Episodes under a controller, from the steady wake, or both."""
    from wake.recording.calm_plan import CalmRound
    from wake.recording.controlled_plan import ControlledRound
    from wake.recording.controlled_recording import record_round
    from wake.recording.feedback import NoFeedback

    policy: PolicyFactory = NoFeedback
    if bundle is not None:
        release, policy = _policy(bundle, config)
        of_plan = {**of_plan, "bundle": release.manifest.name, "bundle_digest": release.digest}
    planned: ControlledRound | CalmRound = ControlledRound(**of_plan) if steady is None else CalmRound(**of_plan)
    acting = "under the controller"
    if steady is not None:
        _settled(steady, config)
        how = {**how, "start": steady}
        by = "" if planned.bundle is None else f" and the controller of {planned.bundle}"
        acting = f"from the steady wake under random actions{by}"
    with _continued(output), _progress(planned.episodes) as shown:
        number = record_round(output, planned, config, policy, **how, **shown)
    console.print(
        f"wrote {output}: round {number}, {planned.episodes * planned.steps} control steps {acting} for "
        f"{planned.role!r}, {output.stat().st_size / 1e6:.1f} MB in all"
    )


def _settled(steady: Path, config: Config) -> None:
    """Compute the steady wake if it is not there, and check that it is one, of this plant."""
    from stillwake.console.settling import settle_into
    from wake.recording.episode_job import check_start
    from wake.truck.state import load_state
    from wake.truck.steady import check_steady
    from wake.truck.truck_wake import TruckWake

    if not steady.exists():
        console.print(f"{steady} is not there: computing the steady wake")
        check_output(steady, overwrite=False)
        settle_into(steady, config)
    check_start(config, steady)
    check_steady(TruckWake(config.flow, body=config.body), load_state(steady))


def _policy(bundle: Path, config: Config) -> tuple[Bundle, "PolicyFactory"]:
    from firmware_sim.ecu.bundle_policy import BundlePolicy
    from firmware_sim.ecu.fit import check_flow

    release = open_release(bundle, None)
    check_flow(release, config.flow)
    # Built once here, so that a model that does not load is refused before anything is recorded.
    policy = partial(BundlePolicy, release, layout=layout_of(config.body))
    policy()
    console.print(*describe(release), sep="\n")
    return release, policy


@contextmanager
def _continued(output: Path) -> Iterator[None]:
    """When the recording is stopped, report how to go on, if there is anything to go on from."""
    from wake.recording.parts_folder import PartsFolder

    try:
        yield
    except KeyboardInterrupt:
        parts = PartsFolder.for_output(output)
        if not parts.has_samples:
            raise
        with go_on_with(f"{parts.path.name} keeps what is recorded, the same command continues it"):
            raise


@contextmanager
def _progress(episodes: int) -> Iterator[dict[str, Any]]:
    """`progress` and `notice` of a recording of so many episodes."""
    # A block takes seconds, and is counted when it is whole: only many of them show the speed.
    with progress_bar("steps", estimate_over=600.0) as bar:
        done: dict[str, tuple[int, int]] = {}
        tasks: dict[str, TaskID] = {}

        def show(name: str, steps: int, total: int) -> None:
            done[name] = (steps, total)
            if len(done) < episodes:
                return
            # What an earlier call recorded counts as done, but not for the speed.
            everything = (sum(part) for part in zip(*done.values(), strict=True))
            for label, (completed, of) in {**done, "all": tuple(everything)}.items():
                if label not in tasks:
                    tasks[label] = bar.add_task(label, total=of, completed=completed, note="")
                bar.update(tasks[label], completed=completed)

        yield {"progress": show, "notice": bar.console.print}


def _given(options: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


def _refuse_given(options: Mapping[str, object], reason: str) -> None:
    for name, value in options.items():
        if value is not None:
            raise StillwakeError(f"--{name} {reason}")
