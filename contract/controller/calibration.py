"""The settings of a release that may be changed on the vehicle: the goal of the control, and the limits of the jets.

In the paper, the weights of the cost are inputs of every control step (section on multi-objective control). So they can
be changed in a fleet without training or flashing. Calibration can narrow the limits but never widen them.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Final

import numpy as np

from contract.config.controller import CostWeights
from contract.controller.interface import TERMS
from contract.errors import ConfigError

CALIBRATION_NAMES: Final = (*TERMS, "action_limit", "command_step", "delay_steps")
"""Names of all calibration values, in the order in which they are packed."""
_PACKED: Final = struct.Struct(f"<{len(CALIBRATION_NAMES) - 1}fI")
PACKED_BYTES: Final = _PACKED.size
LARGEST_WEIGHT: Final = 1000.0
"""Largest accepted weight. It is far above every useful weight; the largest default is 8."""
_MOST_STEPS: Final = 2**32 - 1


def as_float32(value: float) -> float:
    """Round a value to float32, and return the shortest decimal number that gives this float32: 0.1 stays 0.1."""
    with np.errstate(over="ignore"):
        return float(str(np.float32(value)))


def _kept(name: str, value: float) -> float:
    if not isfinite(rounded := as_float32(value)):
        raise ConfigError(f"calibration: {name} = {value:g}: must be a finite float32")
    return rounded


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """A set of calibration values. `action_limit` is the largest |a| that the ECU's command gate permits,
    `command_step` the largest change of the command in a control period, both in U_inf W. `delay_steps` is the actuator
    delay that the controller compensates, in control periods. All other values are rounded to float32, the type on the
    bus and in the controller, so a tool reads what it wrote. Raises ConfigError if a value exceeds its 4 bytes."""

    weights: CostWeights
    action_limit: float
    command_step: float
    delay_steps: int

    def __post_init__(self) -> None:
        *weights, action_limit, command_step = map(_kept, CALIBRATION_NAMES, self.values[:-1])
        if not 0 <= self.delay_steps <= _MOST_STEPS:
            raise ConfigError(f"calibration: delay_steps = {self.delay_steps}: must be in 0..{_MOST_STEPS}")
        object.__setattr__(self, "weights", CostWeights.of(weights))
        object.__setattr__(self, "action_limit", action_limit)
        object.__setattr__(self, "command_step", command_step)

    @property
    def values(self) -> tuple[float, ...]:
        """The values in the order of `CALIBRATION_NAMES`."""
        return (*self.weights.as_tuple(), self.action_limit, self.command_step, float(self.delay_steps))

    @classmethod
    def of(cls, values: Sequence[float]) -> "Calibration":
        """Return a calibration with these `values`. Raises ConfigError for a value that does not fit into 4 bytes."""
        # `_kept` refuses a weight that is not finite, and states its name, before `CostWeights` is built.
        *weights, action_limit, command_step = map(_kept, CALIBRATION_NAMES, values[:-1])
        return cls(
            weights=CostWeights.of(weights),
            action_limit=action_limit,
            command_step=command_step,
            delay_steps=int(values[-1]),
        )

    def pack(self) -> bytes:
        """Pack the values little-endian: `delay_steps` as a 32-bit integer, all other values as float32."""
        return _PACKED.pack(*self.values[:-1], self.delay_steps)

    @classmethod
    def unpack(cls, raw: bytes) -> "Calibration":
        """Read the bytes that `pack` returns. Raises ConfigError for bytes of another length or an invalid value."""
        if len(raw) != PACKED_BYTES:
            raise ConfigError(f"the calibration has {len(raw)} bytes: must have {PACKED_BYTES}")
        return cls.of(_PACKED.unpack(raw))


@dataclass(frozen=True, kw_only=True)
class CalibrationLimits:
    """The smallest and largest allowed calibration values, which follow from the release and the vehicle's settings."""

    least: Calibration
    greatest: Calibration

    def changed(self, now: Calibration, values: Mapping[str, object]) -> Calibration:
        """Return a copy of the calibration `now` in which `values` replace the values with the same names. Raises
        ConfigError for an unknown name, a value that is not a number, or a value outside the limits."""
        wanted = dict(zip(CALIBRATION_NAMES, now.values, strict=True))
        for name, value in values.items():
            if name not in CALIBRATION_NAMES:
                raise ConfigError(f"calibration: {name!r} must be one of {', '.join(CALIBRATION_NAMES)}")
            if not isinstance(value, int | float) or isinstance(value, bool):
                raise ConfigError(f"calibration: {name} = {value!r}: must be a number")
            if name == "delay_steps" and value != value // 1:
                raise ConfigError(f"calibration: delay_steps = {value:g}: must be a whole number of control periods")
            wanted[name] = value
        self._check_values(tuple(wanted.values()))
        return Calibration.of(tuple(wanted.values()))

    def check(self, calibration: Calibration) -> None:
        """Raise ConfigError if a value is out of range; the message states the name of the value and the range."""
        self._check_values(calibration.values)

    def _check_values(self, values: Sequence[float]) -> None:
        rows = zip(CALIBRATION_NAMES, values, self.least.values, self.greatest.values, strict=True)
        for name, value, least, greatest in rows:
            if not least <= value <= greatest:
                raise ConfigError(f"calibration: {name} = {value:g}: must be in {least:g}..{greatest:g}")
