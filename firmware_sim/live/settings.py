"""What a viewer can set on the running loop, as one value, comparable and checked.

Every fault is a disturbance of `firmware_sim.bench.disturbances`, written as a run has it on its command line.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final, Self

from contract.config.controller import CostWeights
from contract.controller.calibration import LARGEST_WEIGHT, WEIGHTS
from contract.errors import ConfigError

CONTROLLERS: Final = ("int8", "c", "cortex-m7", "off")
"""ECU in Python with the release's ONNX graph; its twin in C on this machine; the same on an emulated core; no supply.
The first name is older than graphs of float32: scripts have it."""
PLANTS: Final = ("wake", "recording")
"""The flow solver, which answers the jets; recorded pressures, which do not."""


@dataclass(frozen=True, kw_only=True)
class Slider:
    """Bounds of a number.

    Attributes:
        least, greatest: inclusive.
        step: of the slider; any value within the bounds is taken.
    """

    least: float
    greatest: float
    step: float
    unit: str


SLIDERS: Final = {
    "noise": Slider(least=0.0, greatest=1.0, step=0.05, unit="deviations of all pressures"),
    "bias": Slider(least=-3.0, greatest=3.0, step=0.1, unit="deviations of all pressures"),
    "loss": Slider(least=0.0, greatest=1.0, step=0.05, unit="of the pressure frames"),
    "delay_ms": Slider(least=0.0, greatest=200.0, step=5.0, unit="ms more to the jets"),
}
WEIGHT: Final = Slider(least=0.0, greatest=LARGEST_WEIGHT, step=0.01, unit="")
"""Slider of every cost weight: the bounds of a calibration."""
_SENSORS: Final = ("dead", "biased")
_CHOICES: Final = {"controller": CONTROLLERS, "plant": PLANTS}
_SWITCHES: Final = ("enable", "babble")


@dataclass(frozen=True, kw_only=True)
class LiveSettings:
    """Settings of the running loop; `asdict` of it is accepted back by `changed`.

    Attributes:
        enable: the vehicle wants control.
        noise: standard deviation at every transducer, in global deviations.
        dead: sensor that reads Cp 0; none if empty.
        biased: sensor with the bias; none if empty.
        bias: in global deviations.
        loss: share of the Pressure frames that the ECU does not get.
        delay_ms: by which jet commands reach the vehicle late.
        babble: a node sends at the highest priority without end.
        weights: of the cost, a calibration; the release's if None.
    """

    enable: bool = False
    controller: str = CONTROLLERS[0]
    plant: str = PLANTS[0]
    noise: float = 0.0
    dead: str = ""
    biased: str = ""
    bias: float = 1.0
    loss: float = 0.0
    delay_ms: float = 0.0
    babble: bool = False
    weights: CostWeights | None = field(default=None)

    def changed(self, given: Mapping[str, Any], sensors: Sequence[str], own: CostWeights) -> Self:
        """With other values in place of some. Raises ConfigError naming what is not known, of another type or out of
        its bounds.

        Args:
            given: by the names of the attributes; weights as a mapping by name, or None for the release's.
            own: the release's weights, for those that are not named.
        """
        known = {item.name for item in fields(self)}
        if unknown := sorted(set(given) - known):
            raise ConfigError(f"live setting {unknown[0]!r}: must be one of {', '.join(sorted(known))}")
        values = {name: _checked(name, value, sensors) for name, value in given.items() if name != "weights"}
        if "weights" in given:
            values["weights"] = _weights(given["weights"], self.weights or own)
            if values["weights"] == own:
                values["weights"] = None
        return replace(self, **values)

    @property
    def without_faults(self) -> Self:
        """Request, controller and plant as they are, everything else as at the start."""
        return type(self)(enable=self.enable, controller=self.controller, plant=self.plant)

    @property
    def disturbances(self) -> tuple[str, ...]:
        """Texts of what is set, without their time, in an order that depends on nothing else."""
        texts = (
            (self.noise, f"noise:level={self.noise:g}"),
            (self.dead, f"dead:sensor={self.dead}"),
            (self.biased and self.bias, f"bias:sensor={self.biased},level={self.bias:g}"),
            (self.loss, f"ecu:drop:probability={self.loss:g},at=receive"),
            (self.delay_ms, f"vehicle:delay:delay_s={self.delay_ms / 1e3:g}"),
            (self.babble, "vehicle:babble:"),
        )
        return tuple(text.rstrip(":") for is_set, text in texts if is_set)


def _checked(name: str, value: Any, sensors: Sequence[str]) -> Any:
    if name in _SWITCHES:
        if not isinstance(value, bool):
            raise ConfigError(f"live setting {name} = {value!r}: must be true or false")
        return value
    if name in SLIDERS:
        return _within(name, value, SLIDERS[name])
    choices = _CHOICES.get(name) or ("", *sensors)
    if value not in choices:
        raise ConfigError(
            f"live setting {name} = {value!r}: must be one of {', '.join(item or 'none' for item in choices)}"
        )
    return value


def _within(name: str, value: Any, slider: Slider) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    # No number, infinity and integers beyond any float are out of the bounds as well.
    if not (is_number and slider.least <= value <= slider.greatest):
        raise ConfigError(f"live setting {name} = {value!r}: must be in {slider.least:g}..{slider.greatest:g}")
    return float(value)


def _weights(given: Any, now: CostWeights) -> CostWeights | None:
    if given is None:
        return None
    if not isinstance(given, Mapping) or (set(given) - set(WEIGHTS)):
        raise ConfigError(f"live setting weights = {given!r}: must be numbers by the names {', '.join(WEIGHTS)}")
    return replace(now, **{name: _within(name, value, WEIGHT) for name, value in given.items()})
