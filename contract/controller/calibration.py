"""What may be changed of a release on the vehicle: the goal of the control, and how far the jets may go for it.

The paper's controller takes its goal as data: the weights of the cost are inputs of every control step (section on
multi-objective control), so that a fleet can trade drag for side force without training or flashing anything. The
limits can be narrowed this way, never widened.
"""

import struct
from dataclasses import dataclass, fields
from math import isfinite
from typing import Final

from contract.config.controller import CostWeights
from contract.errors import ConfigError

WEIGHTS: Final = tuple(item.name for item in fields(CostWeights))
"""In the order of the controller's input."""
NAMES: Final = (*WEIGHTS, "action_limit", "command_step", "delay_steps")
"""Of all values, in the order in which they are packed."""
_PACKED: Final = struct.Struct(f"<{len(NAMES) - 1}fI")
PACKED_BYTES: Final = _PACKED.size
LARGEST_WEIGHT: Final = 1000.0
"""Far beyond any that makes sense: the greatest of the defaults is 8."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """One set of values. They are kept as float32, as on the wire, so that what is read back is what was written.

    Attributes:
        weights: of the cost.
        action_limit: largest |a| that the command gate lets pass, in U_inf W.
        command_step: largest change of it in a control period, in U_inf W.
        delay_steps: actuator delay in control periods that is compensated.
    """

    weights: CostWeights
    action_limit: float
    command_step: float
    delay_steps: int

    @property
    def values(self) -> tuple[float, ...]:
        """In the order of `NAMES`."""
        return (*self.weights.as_tuple(), self.action_limit, self.command_step, float(self.delay_steps))

    def pack(self) -> bytes:
        """`PACKED_BYTES` bytes, little-endian: float32 each, and `delay_steps` as a 32-bit integer."""
        return _PACKED.pack(*self.values[:-1], self.delay_steps)

    @classmethod
    def unpack(cls, raw: bytes) -> "Calibration":
        """What `pack` made; raises ConfigError for another length or a value that is no calibration's."""
        if len(raw) != PACKED_BYTES:
            raise ConfigError(f"calibration of {len(raw)} bytes: must have {PACKED_BYTES}")
        *values, delay_steps = _PACKED.unpack(raw)
        for name, value in zip(NAMES, values, strict=False):
            if not isfinite(value):
                raise ConfigError(f"calibration: {name} = {value}: must be finite")
        *weights, action_limit, command_step = values
        return cls(
            weights=CostWeights(**dict(zip(WEIGHTS, weights, strict=True))),
            action_limit=action_limit,
            command_step=command_step,
            delay_steps=delay_steps,
        )

    def as_kept(self) -> "Calibration":
        """With every value rounded to float32."""
        return Calibration.unpack(self.pack())


@dataclass(frozen=True, kw_only=True)
class CalibrationLimits:
    """Least and greatest allowed values: those of the release and of the vehicle's settings, never wider."""

    least: Calibration
    greatest: Calibration

    def check(self, calibration: Calibration) -> None:
        """Raises ConfigError for a value that is out of range; the message names it and the range."""
        rows = zip(NAMES, calibration.values, self.least.values, self.greatest.values, strict=True)
        for name, value, least, greatest in rows:
            if not least <= value <= greatest:
                raise ConfigError(f"calibration: {name} = {value:g}: must be in {least:g}..{greatest:g}")
