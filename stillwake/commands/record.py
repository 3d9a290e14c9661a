"""The command `stillwake record`. It records forced episodes (with --paper, the episodes of the paper's data set), or
adds a round of episodes under a controller or from the steady wake."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from contract.config.body import layout_of
from contract.config.tree import Config
from contract.errors import ConfigError, StillwakeError
from contract.release.checks import Bundle
from stillwake.console import options as shared
from stillwake.console.outputs import check_dataset_name, check_output, claim
from stillwake.console.progress import progress
from stillwake.console.settings import settings
from stillwake.console.stopping import go_on_with
from stillwake.console.terminal import console
from stillwake.parts.releases import describe, open_release

if TYPE_CHECKING:
    from wake.recording.episode_job import PolicyFactory


_STEPS: Final = {"training": 6000, "chirp": 1500, "uncontrolled": 500}
"""Default numbers of control steps of the forced episodes."""
_KINDS: Final = (*_STEPS, "controlled", "calm")

Lengths = Annotated[
    list[str] | None,
    typer.Argument(metavar="KIND=STEPS", help="Number of control steps for a kind of episode.", show_default=False),
]
FromSteady = Annotated[Path | None, typer.Option(help="State file of the steady wake from which episodes begin.")]
Amplitudes = Annotated[
    tuple[float, float] | None, typer.Option(help="Least and greatest rms of random actions, U_inf W (0.0005 0.02).")
]
Episodes = Annotated[int | None, typer.Option(help="Number of episodes: 2 (--under), 8 (--from-steady).", min=1)]
Exploration = Annotated[float | None, typer.Option(help="Rms of the noise on commands / action limit (0.15).")]


def record(
    output: Annotated[
        Path, typer.Argument(help="Data set (.h5 or .hdf5) to write, or to extend (--under, --from-steady).")
    ],
    lengths: Lengths = None,
    paper: Annotated[bool, typer.Option("--paper", help="Record the paper's data set instead; see above.")] = False,
    under: Annotated[Path | None, typer.Option(help="Bundle whose controller drives the jets.")] = None,
    from_steady: FromSteady = None,
    amplitudes: Amplitudes = None,
    episodes: Episodes = None,
    exploration: Exploration = None,
    role: Annotated[str | None, typer.Option(help="Role of the new episodes; see above.")] = None,
    seed: shared.Seed = 1,
    state: shared.State = None,
    overwrite: shared.Overwrite = False,
    workers: shared.Workers = None,
    given: shared.Settings = [],  # noqa: B006  (typer reads it, nothing writes it)
) -> None:
    """Record the forced wake at every control step: pressures at all sensors, drag and side force.

    The default is three episodes with these numbers of control steps: training=6000, a sine whose frequency and
    amplitude vary; chirp=1500, a slow sweep of the frequency, for tests; and uncontrolled=500. Give other numbers to
    change the lengths; 0 leaves an episode out. --paper records 50,000 training steps in ten episodes, 2,500
    uncontrolled steps, 10,000 steps of the chirp, and 10,000 steps of the extended chirp of the paper's appendix A. The
    workers of a scheduler must find the output's folder at the path that this computer uses.

    With --under, record the wake under a controller with exploration, and add episodes of controlled=1100 steps each.
    With --from-steady, record the growth of small disturbances on the steady wake, with or without a controller, in
    episodes of calm=350 steps each. If the file of --from-steady does not exist, the steady wake is computed and
    written to it (see `develop --steady`). The rms of the random actions rises from episode to episode by a constant
    factor, from the first to the second number of --amplitudes. --role controlled or calm excludes the new episodes
    from training.

    --seed determines the waveform of the training episode. With --paper it is the seed of the first of the ten
    episodes, and each further episode has the next number. With --under and --from-steady, --seed determines the
    exploration, the random actions and the starts of the episodes.

    The command can be stopped at any time. The same command continues the recording, and leaves a finished recording
    unchanged.
    """
    steps = lengths_of(lengths or [])
    is_forced = under is None and from_steady is None
    uses = ("body", "flow", "forcing" if is_forced else "forcing.exploration_time")
    config = settings("record", given, uses=uses).config
    claim(output)
    check_dataset_name(output)
    options = {"amplitudes": amplitudes, "exploration": exploration, "episodes": episodes, "role": role, "state": state}
    how = {**shared.workers_of(workers), "start": state}
    if is_forced:
        _check_forced(steps, options, paper=paper)
        _record_forced(output, config, None if paper else {**_STEPS, **steps}, seed, {**how, "overwrite": overwrite})
        return
    _check_round(steps, options, from_steady, paper=paper, overwrite=overwrite)
    of_plan = {"episodes": episodes, "role": role, "seed": seed, "exploration": exploration}
    of_plan["steps"] = steps.get("controlled" if from_steady is None else "calm")
    of_plan["smallest"], of_plan["largest"] = amplitudes or (None, None)
    given_of_plan = {name: value for name, value in of_plan.items() if value is not None}
    _record_round(output, config, from_steady, under, given_of_plan, how)


def lengths_of(texts: list[str]) -> dict[str, int]:
    """Read the numbers of control steps by kind of episode; raises ConfigError for another text."""
    found = {}
    for kind, text in shared.pairs(texts, "training=6000", _KINDS):
        if not (text.isascii() and text.isdigit() and len(text) < 10):
            raise ConfigError(f"{kind}={text}: must be a number of control steps")
        found[kind] = int(text)
    return found


def _check_forced(steps: Mapping[str, int], options: Mapping[str, object], *, paper: bool) -> None:
    for kind, option in (("controlled", "--under BUNDLE"), ("calm", "--from-steady FILE")):
        if kind in steps:
            raise StillwakeError(f"{kind}={steps[kind]}: give {option} as well")
    if paper and steps:
        raise StillwakeError(f"{next(iter(steps))}=STEPS does not go with --paper, which has its own lengths")
    _refuse_given(options, ("amplitudes",), "give --from-steady FILE as well")
    _refuse_given(options, ("exploration",), "needs a controller: give --under BUNDLE as well")
    _refuse_given(options, ("episodes", "role"), "give --under BUNDLE or --from-steady FILE as well")


def _check_round(
    steps: Mapping[str, int], options: Mapping[str, object], steady: Path | None, *, paper: bool, overwrite: bool
) -> None:
    option, own = ("--under", "controlled") if steady is None else ("--from-steady", "calm")
    if paper:
        raise StillwakeError(f"{option} and --paper are two recordings: give one of them")
    if overwrite:
        raise StillwakeError(f"--overwrite does not go with {option}, which adds a round and replaces nothing")
    for kind in steps:
        if kind != own:
            raise StillwakeError(f"{kind}=STEPS does not go with {option}: give {own}=STEPS and --episodes instead")
    if steady is None:
        _refuse_given(options, ("amplitudes",), "give --from-steady FILE as well")
        return
    _refuse_given(options, ("exploration",), "does not go with --from-steady: give --amplitudes instead")
    _refuse_given(options, ("state",), "does not go with --from-steady, which sets the initial state")


def _record_forced(output: Path, config: Config, steps: dict[str, int] | None, seed: int, how: dict[str, Any]) -> None:
    """Record forced episodes with these numbers of control steps, or with the paper's numbers if `steps` is None."""
    from wake.recording.plans import EpisodePlan, paper_plans
    from wake.recording.recorder import record as record_dataset

    if steps is None:
        plans = paper_plans(seed)
    else:
        plans = (
            EpisodePlan(forcing="training", steps=steps["training"], seed=seed),
            EpisodePlan(forcing="chirp", steps=steps["chirp"], seed=0),
            EpisodePlan(forcing="none", steps=steps["uncontrolled"], seed=0),
        )
    plans = tuple(plan for plan in plans if plan.steps > 0)
    if not plans:
        raise StillwakeError(f"nothing to record: give steps for at least one of {', '.join(_STEPS)}")
    with go_on_with(lambda: _advice(output)), _progress(len(plans)) as shown:
        written = record_dataset(output, plans, config, **how, **shown)
    total = sum(plan.steps for plan in plans)
    done = "wrote" if written else "already complete, nothing to record:"
    console.print(f"{done} {output}: {total} control steps, {output.stat().st_size / 1e6:.1f} MB")


def _record_round(
    output: Path, config: Config, steady: Path | None, bundle: Path | None, of_plan: dict[str, Any], how: dict[str, Any]
) -> None:
    from wake.recording.episode_job import NoFeedback
    from wake.recording.plans import CalmRound, ControlledRound
    from wake.recording.recorder import record_round

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
    with go_on_with(lambda: _advice(output)), _progress(planned.episodes) as shown:
        number = record_round(output, planned, config, policy, **how, **shown)
    console.print(
        f"wrote {output}: round {number}, {planned.episodes * planned.steps} control steps {acting} for "
        f"{planned.role!r}, {output.stat().st_size / 1e6:.1f} MB in all"
    )


def _settled(steady: Path, config: Config) -> None:
    """Compute the steady wake if its file does not exist, and check that it is a steady wake of this plant."""
    from stillwake.parts.wakes import settle_into
    from wake.recording.episode_job import check_start
    from wake.truck.develop import check_steady
    from wake.truck.state import load_state
    from wake.truck.truck_wake import TruckWake

    if not steady.exists():
        console.print(f"{steady} is not there: computing the steady wake")
        check_output(steady, overwrite=False)
        settle_into(steady, config)
    check_start(config, steady)
    check_steady(TruckWake(config.flow, body=config.body), load_state(steady))


def _policy(bundle: Path, config: Config) -> tuple[Bundle, "PolicyFactory"]:
    from ecu.bundle_policy import BundlePolicy
    from ecu.fit import check_flow

    release = open_release(bundle)
    check_flow(release, config.flow)
    # The policy is built once before the recording, so that a model that cannot be loaded is refused immediately.
    policy = partial(BundlePolicy, release, layout=layout_of(config.body))
    policy()
    console.print(*describe(release), sep="\n")
    return release, policy


def _advice(output: Path) -> str:
    """Return a text on how to continue the recording; empty if no part of the recording is stored."""
    from wake.recording.episode_job import PartsFolder

    parts = PartsFolder.for_output(output)
    line = f"{parts.path.name} holds the recorded part; the same command continues the recording"
    return line if parts.has_samples else ""


@contextmanager
def _progress(episodes: int) -> Iterator[dict[str, Any]]:
    # Steps are counted when their block is complete. A block takes seconds, so the speed is averaged over many blocks.
    with progress("steps", estimate_over=600.0) as report:
        done: dict[str, tuple[int, int]] = {}

        def show(name: str, steps: int, total: int) -> None:
            done[name] = (steps, total)
            if len(done) < episodes:
                return
            everything = (sum(part) for part in zip(*done.values(), strict=True))
            for label, (completed, of) in {**done, "all": tuple(everything)}.items():
                report(label, completed, of)

        yield {"progress": show, "notice": console.print}


def _refuse_given(options: Mapping[str, object], names: Sequence[str], reason: str) -> None:
    for name in names:
        if options[name] is not None:
            raise StillwakeError(f"--{name}: {reason}")
