"""The commands that draw: `stillwake picture ...` for stills and means, `stillwake animate` for runs."""

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

import numpy as np
import numpy.typing as npt
import typer

from contract.config.tree import Config
from contract.errors import ConfigError
from stillwake.console.claims import claim
from stillwake.console.numbers import steps_of
from stillwake.console.settings import settings
from stillwake.console.terminal import ConfigFile, Overrides, console, progress_bar

if TYPE_CHECKING:
    from firmware_sim.runs.run_log import RunLog
    from wake.truck.truck_wake import TruckWake

USUAL_DURATION: Final = 25.0
"""t_c: five shedding cycles."""

STILL: Final = ("body", "flow")
"""Settings that a picture of one state uses."""
MOVING: Final = ("body", "flow", "forcing")
"""Settings that a run uses."""

picture = typer.Typer(no_args_is_help=True, help="Draw the flow: vorticity, pressure, or a mean over time.")


Forcing = Literal["none", "sine", "training", "chirp", "extended_chirp"]
Field = Literal["vorticity", "pressure"]

Output = Annotated[Path, typer.Argument(help="File to write: .png, .pdf or .svg; a picture that is there is replaced.")]
StateFile = Annotated[Path | None, typer.Option("--state", help="Flow state (.npz); default: the shipped start.")]
SensorNames = Annotated[
    str, typer.Option("--sensors", help="Comma-separated sensors to colour by Cp; default: a run's, or all.")
]
ForcingName = Annotated[Forcing, typer.Option(help="What the jets do.")]
Amplitude = Annotated[float | None, typer.Option(help="Amplitude of the sine, U_inf W; default: the action's limit.")]
Frequency = Annotated[float, typer.Option(help="Frequency of the sine, 1/t_c.")]
Seed = Annotated[int, typer.Option(help="Seed of the training waveform.", min=0)]
RunFolder = Annotated[Path | None, typer.Option("--run", help="Folder written by `run`: replay its actions.")]
Duration = Annotated[
    float | None, typer.Option(help="How long to run, in t_c; default: 25, or all of a run folder.", min=0.2)
]


@picture.command()
def vorticity(
    output: Output,
    state: StateFile = None,
    sensors: SensorNames = "",
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006  (typer reads it, nothing writes it)
) -> None:
    """Vorticity around the truck, its jets, and wall pressure at the sensors."""
    config = settings("picture vorticity", config_file, overrides, uses=STILL).config
    _still(output, "vorticity", state, sensors, config)


@picture.command()
def pressure(
    output: Output,
    state: StateFile = None,
    sensors: SensorNames = "",
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Pressure around the truck and at its sensors."""
    config = settings("picture pressure", config_file, overrides, uses=STILL).config
    _still(output, "pressure", state, sensors, config)


@picture.command()
def mean(
    output: Output,
    state: StateFile = None,
    duration: Duration = None,
    settle: Annotated[float, typer.Option(help="Run, but left out of the mean, t_c.", min=0.0)] = 0.0,
    forcing: ForcingName = "none",
    amplitude: Amplitude = None,
    frequency: Frequency = 0.2,
    seed: Seed = 1,
    run: RunFolder = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Mean flow behind the truck with streamlines; prints the length of the recirculation bubble and mean forces."""
    from wake.pictures.drawing import check_suffix, mean_figure, save_figure
    from wake.pictures.fields import mean_flow
    from wake.truck.recirculation import recirculation_length

    check_suffix(output)
    claim(output)
    config = settings("picture mean", config_file, overrides, uses=MOVING).config
    actions = _actions(config, duration, forcing, amplitude, frequency, seed, run)
    skip = steps_of("--settle", settle, config.flow.control_period, least=0)
    if skip >= len(actions):
        raise ConfigError(f"--settle {settle}: must be shorter than the run of {_time(config, len(actions)):g} t_c")
    wake = _start(config, state)
    with progress_bar("steps") as bar:
        task = bar.add_task("mean flow", total=len(actions), note="")
        flow = mean_flow(wake, actions, skip, lambda done, _: bar.update(task, completed=done))
    save_figure(output, mean_figure(wake.grid, wake.body, flow, _time(config, len(actions) - skip)))
    measured = wake.surface.measure(flow)
    length = recirculation_length(wake.grid, flow)
    console.print(f"bubble length {length:.3f} W, Cd {measured.Cd:.4f}, Cl {measured.Cl:+.4f}")
    console.print(f"wrote {output}")


def animate(
    output: Annotated[
        Path,
        typer.Argument(help="File to write: .gif or .webp; a picture there is replaced."),
    ],
    state: StateFile = None,
    duration: Duration = None,
    skip: Annotated[float, typer.Option(help="Run before the first frame, t_c.", min=0.0)] = 0.0,
    field: Annotated[Field, typer.Option(help="What colours the flow.")] = "vorticity",
    forcing: ForcingName = "none",
    amplitude: Amplitude = None,
    frequency: Frequency = 0.2,
    seed: Seed = 1,
    run: RunFolder = None,
    sensors: SensorNames = "",
    every: Annotated[int, typer.Option(help="Control steps between frames.", min=1)] = 1,
    fps: Annotated[int, typer.Option(help="Frames per second.")] = 10,
    width: Annotated[int, typer.Option(help="Pixels.", min=400, max=4000)] = 800,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Run the wake and write it as a moving picture: without control, forced, or replaying recorded actions."""
    from wake.pictures.animation import animate as write_animation
    from wake.pictures.animation import check_target
    from wake.pictures.drawing import WakePicture

    check_target(output)
    claim(output)
    config = settings("animate", config_file, overrides, uses=MOVING).config
    left_out = steps_of("--skip", skip, config.flow.control_period, least=0)
    actions = _actions(config, duration, forcing, amplitude, frequency, seed, run)
    wake = _start(config, state)
    coloured = _run_log(run).metadata.sensors if run is not None and not sensors else _names(sensors)
    drawn = WakePicture(wake, field, coloured, width)
    with progress_bar("steps") as bar:
        task = bar.add_task("animation", total=len(actions), note="")
        frames = write_animation(
            output, drawn, wake, actions, skip=left_out, every=every, fps=fps,
            progress=lambda done, _: bar.update(task, completed=done),
        )  # fmt: skip
    console.print(f"wrote {output}: {frames} frames, {output.stat().st_size / 1e6:.2f} MB")


def _still(output: Path, field: Field, state: Path | None, sensors: str, config: Config) -> None:
    from wake.pictures.drawing import WakePicture, check_suffix, save_figure

    check_suffix(output)
    claim(output)
    wake = _start(config, state)
    save_figure(output, WakePicture(wake, field, _names(sensors)).update())
    console.print(f"wrote {output}")


def _names(listed: str) -> tuple[str, ...] | None:
    return tuple(name.strip() for name in listed.split(",")) if listed else None


def _start(config: Config, state: Path | None) -> "TruckWake":
    from wake.truck.state import developed_state, load_state
    from wake.truck.truck_wake import TruckWake

    start = developed_state() if state is None else load_state(state)
    wake = TruckWake(config.flow, body=config.body)
    wake.reset(start)
    return wake


def _time(config: Config, steps: int) -> float:
    return steps * config.flow.control_period


def _actions(
    config: Config,
    duration: float | None,
    forcing: Forcing,
    amplitude: float | None,
    frequency: float,
    seed: int,
    run: Path | None,
) -> npt.NDArray[np.float64]:
    """The actions to command in turn, one a control period: from a signal, or those of a run."""
    if run is not None and forcing != "none":
        raise ConfigError("--forcing and --run exclude each other: give one")
    asked = None if duration is None else steps_of("--duration", duration, config.flow.control_period)
    if run is None:
        usual = round(USUAL_DURATION / config.flow.control_period)
        return _signal(config, usual if asked is None else asked, forcing, amplitude, frequency, seed)
    # Row k holds the action reached at t_k, and the plant is to ramp there from the one before.
    recorded: npt.NDArray[np.float64] = _run_log(run).series["action"][1:]
    steps = len(recorded) if asked is None else asked
    if steps > len(recorded):
        raise ConfigError(f"--duration {duration}: the recording holds {_time(config, len(recorded)):g} t_c")
    return recorded[:steps]


def _signal(
    config: Config, steps: int, forcing: Forcing, amplitude: float | None, frequency: float, seed: int
) -> npt.NDArray[np.float64]:
    from wake.recording.forcing import SIGNALS, sine

    if not (isfinite(frequency) and frequency > 0.0):
        raise ConfigError(f"--frequency {frequency:g}: must be a positive number")
    if forcing == "sine":
        height = config.flow.action_limit if amplitude is None else amplitude
        return sine(steps, config.flow, amplitude=height, frequency=frequency)
    if amplitude is not None:
        raise ConfigError(f"--amplitude {amplitude}: only --forcing sine has one")
    return SIGNALS[forcing](steps, config.forcing, config.flow, np.random.default_rng(seed))


def _run_log(folder: Path) -> "RunLog":
    from firmware_sim.runs.run_folder import RunFolder
    from firmware_sim.runs.run_log import load

    return load(RunFolder(folder).series)
