"""The command that draws the flow: a state, a mean over time, or an animation."""

from functools import partial
from math import isfinite
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal, cast

import numpy as np
import numpy.typing as npt
import typer

from contract.config.tree import Config
from contract.errors import ConfigError
from stillwake.console import options as shared
from stillwake.console.outputs import claim
from stillwake.console.progress import progress
from stillwake.console.settings import settings
from stillwake.console.terminal import console

if TYPE_CHECKING:
    from firmware_sim.runs.run_log import RunLog
    from wake.pictures.drawing import WakePicture
    from wake.recording.plans import ForcingName
    from wake.truck.truck_wake import TruckWake

_MOVING: Final = (".gif", ".webp")
"""File name endings that select an animation."""
FORCINGS: Final = {
    "none": (),
    "sine": ("amplitude", "frequency"),
    "training": ("seed",),
    "chirp": (),
    "extended_chirp": (),
}
"""The forcings of the jets, with the names of their parameters."""
Duration = Annotated[float | None, typer.Option(help="Simulated time, t_c; default: 25, or all of a run.", min=0.2)]
Forcing = Annotated[str, typer.Option(metavar="TEXT|RUN", help="Actions of the jets, or a run folder to replay.")]


def picture(
    output: Annotated[Path, typer.Argument(help="Still picture (.png, .pdf, .svg) or animation (.gif, .webp).")],
    field: Annotated[Literal["vorticity", "pressure", "mean"], typer.Option(help="Quantity to draw.")] = "vorticity",
    state: shared.State = None,
    sensors: shared.Sensors = None,
    duration: Duration = None,
    settle: Annotated[float, typer.Option(help="Simulated time before the picture begins, t_c.", min=0.0)] = 0.0,
    forcing: Forcing = "none",
    every: Annotated[int, typer.Option(help="Control steps between frames.", min=1)] = 1,
    width: Annotated[int, typer.Option(help="Width of an animation, in pixels.", min=400, max=4000)] = 800,
    given: shared.Settings = [],  # noqa: B006  (typer reads it, nothing writes it)
) -> None:
    """Draw the flow (vorticity or pressure, the jets, and wall pressure at the sensors), or the mean flow with
    streamlines.

    A still picture shows the state. For --field mean and for an animation, the wake is simulated from the state:
    without control, with the jets forced, or with the actions of a run folder. The forcings are none, sine, training
    (training:seed=2), chirp and extended_chirp. A sine without parameters has the action limit as amplitude and the
    frequency 0.2 / t_c. With --field mean the command also reports the length of the recirculation bubble and the mean
    forces. The sensors of --sensors are coloured by Cp; by default they are the run's sensors, or all sensors.
    """
    from wake.pictures.drawing import PICTURES, WakePicture, check_suffix, check_target, save_figure

    if output.suffix.lower() not in (*PICTURES, *_MOVING):
        raise ConfigError(f"{output}: must be a file ending in {', '.join((*PICTURES, *_MOVING))}")
    moves = output.suffix.lower() in _MOVING
    if moves and field == "mean":
        raise ConfigError(f"{output}: the mean flow is a still picture; name a file that ends in .png, .pdf or .svg")
    (check_target if moves else check_suffix)(output)
    claim(output)
    used = ("body", "flow", "forcing") if moves or field == "mean" else ("body", "flow")
    config = settings("picture", given, uses=used).config
    if field != "mean" and not moves:
        if duration is not None or settle or forcing != "none":
            raise ConfigError("--duration, --settle and --forcing are only for --field mean or an animation")
        save_figure(output, WakePicture(_start(config, state), field, shared.names_in(sensors)).update())
        console.print(f"wrote {output}")
        return
    actions = actions_of(config, duration, forcing)
    skip = shared.steps_of("--settle", settle, config.flow.control_period, least=0)
    if skip >= len(actions):
        raise ConfigError(f"--settle {settle}: must be shorter than the run of {_time(config, len(actions)):g} t_c")
    wake = _start(config, state)
    if field == "mean":
        _draw_mean(output, wake, config, actions, skip)
        return
    coloured = shared.names_in(sensors)
    if coloured is None and forcing.partition(":")[0] not in FORCINGS:
        coloured = _run_log(Path(forcing)).metadata.sensors
    _draw_moving(output, WakePicture(wake, field, coloured, width), wake, actions, skip, every)


def _draw_mean(output: Path, wake: "TruckWake", config: Config, actions: npt.NDArray[np.float64], skip: int) -> None:
    from wake.pictures.drawing import mean_figure, save_figure
    from wake.pictures.fields import mean_flow
    from wake.truck.develop import recirculation_length

    with progress("steps") as report:
        report("mean flow", 0, len(actions))
        flow = mean_flow(wake, actions, skip, lambda done, _: report("mean flow", done, len(actions)))
    save_figure(output, mean_figure(wake.grid, wake.body, flow, _time(config, len(actions) - skip)))
    measured = wake.surface.measure(flow)
    length = recirculation_length(wake.grid, flow)
    console.print(f"bubble length {length:.3f} W, Cd {measured.Cd:.4f}, Cl {measured.Cl:+.4f}")
    console.print(f"wrote {output}")


def _draw_moving(
    output: Path, drawn: "WakePicture", wake: "TruckWake", actions: npt.NDArray[np.float64], skip: int, every: int
) -> None:
    from wake.pictures.drawing import animate

    with progress("steps") as report:
        report("animation", 0, len(actions))
        show = partial(report, "animation")
        frames = animate(output, drawn, wake, actions, skip=skip, every=every, progress=show)
    console.print(f"wrote {output}: {frames} frames, {output.stat().st_size / 1e6:.2f} MB")


def _start(config: Config, state: Path | None) -> "TruckWake":
    from wake.truck.state import developed_state, load_state
    from wake.truck.truck_wake import TruckWake

    start = developed_state() if state is None else load_state(state)
    wake = TruckWake(config.flow, body=config.body)
    wake.reset(start)
    return wake


def _time(config: Config, steps: int) -> float:
    return steps * config.flow.control_period


def actions_of(config: Config, duration: float | None, forcing: str) -> npt.NDArray[np.float64]:
    """Return the actions to command, one per control period: from a forcing, or from a run folder. Raises
    StillwakeError for a forcing that does not exist, or a run that is shorter than `duration` in t_c, has a drive, or
    has another body, Reynolds number or control period."""
    asked = None if duration is None else shared.steps_of("--duration", duration, config.flow.control_period)
    if forcing.partition(":")[0] in FORCINGS:
        usual = round(25.0 / config.flow.control_period)
        return _signal(config, usual if asked is None else asked, forcing)
    # Row k has the action reached at t_k. The plant ramps to this action from the action in row k - 1, so the commands
    # are the actions from row 1 on.
    log = _run_log(Path(forcing))
    own = log.metadata.config
    if log.metadata.drive is not None:
        raise ConfigError(f"--forcing {forcing}: the run has a drive, but a picture has a constant speed")
    for name in ("body", "flow.reynolds", "flow.control_period"):
        if (there := attrgetter(name)(own)) != (here := attrgetter(name)(config)):
            raise ConfigError(f"--forcing {forcing}: {name} is {there} in the run, but {here} in the settings")
    recorded: npt.NDArray[np.float64] = log.series["action"][1:]
    steps = len(recorded) if asked is None else asked
    if steps > len(recorded):
        raise ConfigError(f"--duration {duration}: the recording is {_time(config, len(recorded)):g} t_c long")
    return recorded[:steps]


def _signal(config: Config, steps: int, forcing: str) -> npt.NDArray[np.float64]:
    from wake.recording.plans import SIGNALS, sine

    kind, _, text = forcing.partition(":")
    texts = shared.pairs(text.split(",") if text else [], "sine:amplitude=0.05", FORCINGS[kind] or ("no parameter",))
    try:
        values = {name: float(value) for name, value in texts}
    except ValueError:
        raise ConfigError(f"--forcing {forcing}: its parameters must be numbers") from None
    if kind == "sine":
        frequency = values.get("frequency", 0.2)
        if not (isfinite(frequency) and frequency > 0.0):
            raise ConfigError(f"--forcing {forcing}: frequency must be a positive number")
        height = values.get("amplitude", config.flow.action_limit)
        return sine(steps, config.flow, amplitude=height, frequency=frequency)
    seed = values.get("seed", 1.0)
    if not (0.0 <= seed < 2.0**32 and seed.is_integer()):
        raise ConfigError(f"--forcing {forcing}: seed must be a whole number from 0 to 2^32 - 1")
    return SIGNALS[cast("ForcingName", kind)](steps, config.forcing, config.flow, np.random.default_rng(int(seed)))


def _run_log(folder: Path) -> "RunLog":
    from firmware_sim.runs.run_log import RunFolder, load

    return load(RunFolder(folder).series)
