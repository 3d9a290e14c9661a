"""The controller program, which has all data for a lowering (an ONNX graph or a C library), and windows for tests.

Rounding and lowerings refer to the weight matrices by the names of their tensors, such as `lstm.weight_input`,
`dynamics.hidden.weight`, `decoder.blocks.0.linear.weight`. The prior is small; only its two matrices for filtered rows
are rounded and have names: `prior.first` (6 n, F (p + 1)), with one row per schedule variable and unit, and
`prior.sums` (n, F p), for n units, F filters and p sensor pairs. All lowerings of a program state the program's hash.
"""

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

from contract.arrays import Array
from contract.config.controller import MpcConfig
from contract.controller.goal import SPEED_PLACES
from contract.controller.interface import Sizes
from contract.errors import ExportError
from contract.model.model_folder import SLIM, ModelFolder
from contract.recording.episode import Episode
from contract.release.manifest import Scaling
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK
from export.program.weights import DecoderWeights, DynamicsWeights, EncoderWeights, PriorWeights


@dataclass(frozen=True, kw_only=True, eq=False)
class ControllerProgram:
    """The networks (paper, table 1) and the optimiser's settings. Raises ExportError if parts are inconsistent; the
    message names the part.

    Attributes:
        scaling: pressures and forces are scaled as (value - mean) / std, actions as a / action_std.
        action_limit: bound on the action's magnitude |a|, in U_inf W.
        sensors: names of the sensors, in the order of the window's columns.
        encoder_rows: number of the window's newest rows that the encoder reads.
        prior: weights of the prior, which computes the plan from which the optimiser starts; if None, the optimiser
            starts from the previous plan.
    """

    encoder: EncoderWeights
    dynamics: DynamicsWeights
    decoder: DecoderWeights
    scaling: Scaling
    mpc: MpcConfig
    action_limit: float
    sensors: tuple[str, ...]
    encoder_rows: int
    prior: PriorWeights | None = None

    def __post_init__(self) -> None:
        _check_scaling(self.scaling)
        for other, latent in (("dynamics", self.dynamics.latent), ("decoder", self.decoder.latent)):
            if latent != self.encoder.latent:
                raise ExportError(f"{other}: the latent size is {latent}, but the encoder's is {self.encoder.latent}")
        if self.encoder.inputs != (needed := len(self.sensors) + 1):
            inputs = f"{self.encoder.inputs} inputs, but must have {needed} (the sensors and the action)"
            raise ExportError(f"encoder.lstm.weight_ih_l0: has {inputs}")
        if self.prior is not None and self.prior.memory < 2:
            raise ExportError(f"prior.filters: has {self.prior.memory} rows, but must have at least 2")
        if self.prior is not None and 2 * self.prior.pairs != len(self.sensors):
            raise ExportError(
                f"prior.first: has {self.prior.pairs} differences, but must have {len(self.sensors)} / 2 (one per pair)"
            )

    @property
    def window(self) -> int:
        """L, the number of past control steps in the window: the larger number of those that encoder and prior read."""
        return max(self.encoder_rows, 0 if self.prior is None else self.prior.memory)

    @property
    def knows_speed(self) -> bool:
        """Whether plans depend on the vehicle's speed."""
        return self.prior is not None and self.prior.knows_speed

    @property
    def latent(self) -> int:
        """n_z, the size of the latent state."""
        return self.encoder.latent

    @property
    def sizes(self) -> Sizes:
        """The sizes of the inputs and outputs of a control step."""
        return Sizes(window=self.window, sensors=len(self.sensors), horizon=self.mpc.horizon)


def _check_scaling(scaling: Scaling) -> None:
    for name in ("pressure_mean", "pressure_std", "force_mean", "force_std"):
        values = np.asarray(getattr(scaling, name), dtype=np.float64)
        if not np.isfinite(values).all() or (name.endswith("_std") and not (values > 0).all()):
            rule = "positive and finite" if name.endswith("_std") else "finite"
            raise ExportError(f"scaling.{name} = {values.tolist()}: must be {rule}")
    if not (np.isfinite(scaling.action_std) and scaling.action_std > 0):
        raise ExportError(f"scaling.action_std = {scaling.action_std}: must be positive and finite")


def program_of(model: ModelFolder, mpc: MpcConfig) -> ControllerProgram:
    """Return a trained model's controller with these optimiser settings: the slim encoder, and the slim dynamics and
    decoder if the model has them, but not the teacher. Raises ExportError if tensors are invalid or inconsistent."""
    about = model.description
    return ControllerProgram(
        encoder=EncoderWeights.from_state(model.network(SLIM)),
        dynamics=DynamicsWeights.from_state(model.deployed("dynamics")),
        decoder=DecoderWeights.from_state(model.deployed("decoder")),
        scaling=about.scaling.of_sensors(about.layout.indices(about.sensors)),
        mpc=mpc,
        action_limit=about.config.flow.action_limit,
        sensors=about.sensors,
        encoder_rows=about.config.model.window,
        prior=PriorWeights.from_state(model.prior) if model.prior else None,
    )


def matrices(program: ControllerProgram) -> dict[str, Array]:
    """Return every matrix, (outputs, inputs), by its name."""
    found: dict[str, Array] = {}
    map_matrices(program, found.setdefault)
    return found


def map_matrices(program: ControllerProgram, change: Callable[[str, Array], Array]) -> ControllerProgram:
    """Return the program with every matrix replaced by `change(name, matrix)`; all other parts are unchanged."""
    prior = program.prior
    if prior is not None:
        first, sums = prior.first, prior.sums
        prior = replace(
            prior,
            first=change("prior.first", first.reshape(-1, first[0, 0].size)).reshape(first.shape),
            sums=change("prior.sums", sums.reshape(len(sums), -1)).reshape(sums.shape),
        )
    networks = {name: _mapped(getattr(program, name), name, change) for name in ("encoder", "dynamics", "decoder")}
    return replace(program, prior=prior, **networks)


def _mapped(part: Any, name: str, change: Callable[[str, Array], Array]) -> Any:
    """Return a part of a network with its matrices replaced. Names begin with the network's name, except the LSTM's."""
    if isinstance(part, np.ndarray):
        return change(name.replace("encoder.lstm.", "lstm."), part) if part.ndim == 2 else part
    if isinstance(part, tuple):
        return tuple(_mapped(item, f"{name}.{place}", change) for place, item in enumerate(part))
    named = {item.name: getattr(part, item.name) for item in fields(part)}
    return replace(part, **{key: _mapped(item, f"{name}.{key}", change) for key, item in named.items()})


def program_sha256(program: ControllerProgram) -> str:
    """Return a program's SHA-256 in hex. It covers every setting, and name and float64 values of every weight array."""
    digest = hashlib.sha256()
    parts = ("scaling", "mpc", "encoder", "dynamics", "decoder")
    settings: dict[str, Any] = {name: asdict(getattr(program, name)) for name in parts}
    settings |= {name: getattr(program, name) for name in ("encoder_rows", "action_limit", "sensors", "window")}
    if program.prior is not None:
        settings["prior"] = asdict(program.prior) | _as_trained(program.prior)
    digest.update(json.dumps(settings, sort_keys=True, default=_fingerprint).encode())
    return digest.hexdigest()


def _as_trained(prior: PriorWeights) -> dict[str, Array]:
    """Return the prior's weights in the form that is hashed. If the weights for speeds below and above the design speed
    are equal, they are hashed once, so a model with one speed variable keeps its hash."""
    first, gate, (below, above) = prior.first, prior.gate, SPEED_PLACES
    if np.array_equal(first[below], first[above]) and np.array_equal(gate[:, below], gate[:, above]):
        first, gate = np.delete(first, above, axis=0), np.delete(gate, above, axis=1)
    return {"first": first, "gate": gate}


def _fingerprint(value: object) -> str:
    array = np.asarray(value, dtype="<f8")
    return f"{array.shape} {hashlib.sha256(array.tobytes()).hexdigest()}"


def recorded_windows(
    program: ControllerProgram, episode: Episode, count: int, layout: SensorLayout = TRUCK
) -> list[Array]:
    """Return the episode's last `count` consecutive windows (L, S+1) of L rows and S sensors; row k is (Cp_k, a_{k-1}).
    The last windows are used because a recording begins with a transient. Raises ConfigError if the layout lacks a
    sensor of the program; ExportError if the episode is too short."""
    needed = program.window + count - 1
    if count < 1 or len(episode) < needed:
        raise ExportError(f"episode {episode.name} has {len(episode)} steps, but {count} windows need {needed}")
    rows = episode.rows(layout.indices(program.sensors))[-needed:]
    return [rows[i : i + program.window] for i in range(count)]


def random_window(program: ControllerProgram, rng: np.random.Generator) -> Array:
    """Return a random window (L, S+1) that varies about as fast as recorded windows: each column is a sum of a few slow
    sines. Pressures have the mean and standard deviation of the program's scaling; actions are within its limit."""
    columns = len(program.sensors) + 1
    t = np.arange(program.window)[:, None, None]
    frequency = rng.uniform(0.01, 0.1, (1, columns, 3))
    waves = np.sin(2 * np.pi * (frequency * t + rng.random((1, columns, 3)))).mean(axis=-1)
    pressure = np.array(program.scaling.pressure_mean) + 2.0 * waves[:, :-1] * program.scaling.pressure_std
    return np.column_stack([pressure, waves[:, -1] * program.action_limit])


def random_windows(program: ControllerProgram, count: int, *, seed: int = 0) -> list[Array]:
    """Return `count` independent random windows, which are not consecutive."""
    rng = np.random.default_rng(seed)
    return [random_window(program, rng) for _ in range(count)]
