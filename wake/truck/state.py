"""A state from which a plant of stillwake's solver can continue, in memory and on disk."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from contract.arrays import Array
from contract.atomic import replacing
from contract.config.body import TRUCK_BODY, BodyConfig
from contract.errors import PlantError
from contract.npz import read_npz
from contract.shipped import developed

_STATE_SCHEMA: Final = "stillwake-flow/2"
_BODY: Final = ("body_length", "leading_edge_radius")


@dataclass(frozen=True, kw_only=True)
class Origin:
    """The plant on which a state was computed. Positions of sensors are left out, because they do not affect the flow.
    `control_period` and `substeps` are None if the state is from an old file without these values."""

    shape: tuple[int, int]
    reynolds: float
    control_period: float | None = None
    substeps: int | None = None
    body_length: float = TRUCK_BODY.length
    leading_edge_radius: float = TRUCK_BODY.leading_edge_radius

    def is_of(self, body: BodyConfig) -> bool:
        """Return whether the flow of this origin is around the given body."""
        return (self.body_length, self.leading_edge_radius) == (body.length, body.leading_edge_radius)


@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """The data that determine how the flow continues: velocities, pressures, the number of substeps since t = 0, and
    the action in force. A plant rejects a state of another plant, and accepts a state without origin."""

    flat: Array
    substep: int
    action: float
    origin: Origin | None = None


def start_name(reynolds: float) -> str:
    """Return the file name that messages suggest for a start at a Reynolds number."""
    return f"start_re{reynolds:g}.npz"


def develops(reynolds: float) -> str:
    """Return the command that computes a start at a Reynolds number."""
    return f"stillwake develop {start_name(reynolds)} --set flow.reynolds={reynolds:g}"


def check_origin(
    origin: Origin | None, body: BodyConfig, reynolds: float | None = None, shape: tuple[int, int] | None = None
) -> None:
    """Raise PlantError if a state does not have this body, Reynolds number or grid (`shape`). None is not compared."""
    if origin is None:
        return
    if not origin.is_of(body):
        raise PlantError(
            f"flow state is for a body of length {origin.body_length:g} and leading-edge radius "
            f"{origin.leading_edge_radius:g}, this plant has {body.length:g} and {body.leading_edge_radius:g}: "
            "`stillwake develop` with the same --set body.* makes a file for --state"
        )
    if shape is not None and origin.shape != shape:
        (nx, ny), (mine_x, mine_y) = origin.shape, shape
        raise PlantError(
            f"flow state is for a grid of {nx} x {ny} cells, this grid needs {mine_x} x {mine_y}: `stillwake develop` "
            "with the same --set flow.refinement makes a file for --state"
        )
    if reynolds is not None and origin.reynolds != reynolds:
        raise PlantError(
            f"flow state is for reynolds = {origin.reynolds:g}, this plant has {reynolds:g}: "
            f"`{develops(reynolds)}` makes a file for --state"
        )


def save_state(path: Path, state: State) -> None:
    """Write a state, completely or not at all. Raises PlantError if the state has no origin."""
    origin = state.origin
    if origin is None:
        raise PlantError(f"{path}: a state without its origin cannot be written: use `TruckWake.state`")
    clock: dict[str, Any] = (
        {} if origin.substeps is None else {"control_period": origin.control_period, "substeps": origin.substeps}
    )
    # As in earlier releases, a file for the truck has no entries for the body.
    shape: dict[str, Any] = {} if origin.is_of(TRUCK_BODY) else {name: getattr(origin, name) for name in _BODY}
    always: dict[str, Any] = {"schema": _STATE_SCHEMA, "flat": state.flat, "substep": state.substep}
    always |= {"action": state.action, "shape": origin.shape, "reynolds": origin.reynolds}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **always, **clock, **shape)


def load_state(path: Path) -> State:
    """Read a saved state. Raises PlantError if the file is missing or damaged, or has another schema."""
    try:
        data = read_npz(path)
        if data.text("schema") != _STATE_SCHEMA:
            raise PlantError(f"{path} has schema {data['schema']}, but this version reads {_STATE_SCHEMA!r}")
        nx, ny = data.numbers("shape", 2)
        one = {name: float(data.numbers(name)) for name in data if not data[name].shape and name != "schema"}
        clocked = "substeps" in data
        return State(
            flat=data.numbers("flat", None),
            substep=int(one["substep"]),
            action=one["action"],
            origin=Origin(
                shape=(int(nx), int(ny)),
                reynolds=one["reynolds"],
                control_period=one["control_period"] if clocked else None,
                substeps=int(one["substeps"]) if clocked else None,
                **{name: one[name] for name in _BODY if name in one},
            ),
        )
    except KeyError as error:
        raise PlantError(f"{path} is not a flow state (it lacks {error})") from error
    except (OSError, ValueError) as error:
        raise PlantError(f"{path} is not a flow state ({getattr(error, 'strerror', None) or error})") from error


def developed_state() -> State:
    """Return the truck's shipped start: developed shedding with shut jets."""
    return load_state(developed())
