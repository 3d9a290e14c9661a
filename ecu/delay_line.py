"""A value that takes effect a fixed number of control periods after it was given."""

from dataclasses import dataclass
from typing import Self


@dataclass(frozen=True)
class DelayLine:
    """The latest `delay + 1` values, oldest first; the line is always full. `values` is (delay + 1,)."""

    values: tuple[float, ...]

    @classmethod
    def filled(cls, delay: int, value: float = 0.0) -> Self:
        """A line on which `value` stands everywhere; `delay` in control periods."""
        return cls((value,) * (delay + 1))

    @property
    def in_force(self) -> float:
        """What takes effect now: given `delay` periods ago."""
        return self.values[0]

    @property
    def newest(self) -> float:
        """What was given last."""
        return self.values[-1]

    @property
    def pending(self) -> tuple[float, ...]:
        """What takes effect in the next `delay` periods, (delay,)."""
        return self.values[1:]

    def pushed(self, value: float) -> Self:
        """The line one period later, with `value` given now."""
        return type(self)((*self.values[1:], value))
