"""The settings that a viewer can change while the loop runs, as one comparable and checked value. Every fault is a
disturbance of `firmware_sim.bench.disturbances`, written as on the command line of a run."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final, Self

from contract.config.controller import CostWeights
from contract.controller.calibration import LARGEST_WEIGHT, Calibration, CalibrationLimits
from contract.controller.interface import TERMS
from contract.errors import ConfigError

_TRUE: Final = ("clear", "power_cycle", "restart")
ACTIONS: Final = ("set", "pause", *_TRUE)
"""Actions of a request. set: change values with `LiveSettings.changed`. pause: pause or continue. clear: reset
everything except the request, the controller and the plant, and re-arm after a latched fault. power_cycle: restart the
ECU. restart: start again from the plant's initial state."""
CONTROLLERS: Final = ("python", "c", "mcu", "off")
"""Names of the ECUs: Python with the ONNX graph, C on this machine, C on an emulated microcontroller, no supply."""
PLANTS: Final = ("wake", "recording")
"""Names of the plants: the flow solver, and recorded pressures, which do not respond to the jets."""


def asked(request: object) -> tuple[str, Any]:
    """Return the requested action and its value: a dict for `set`, otherwise a bool. Raises ConfigError if invalid."""
    if not isinstance(request, dict):
        raise ConfigError("request: must be a JSON object")
    actions = [name for name in request if name != "id"]
    if len(actions) != 1 or actions[0] not in ACTIONS:
        raise ConfigError(f"request: must have exactly one of {', '.join(ACTIONS)}; an id is optional")
    action, value = actions[0], request[actions[0]]
    if action == "set" and not isinstance(value, dict):
        raise ConfigError("request: set must be a JSON object")
    if action == "pause" and not isinstance(value, bool):
        raise ConfigError("request: pause must be true or false")
    if action in _TRUE and value is not True:
        raise ConfigError(f"request: {action} must be true")
    return action, value


@dataclass(frozen=True, kw_only=True)
class Slider:
    """The bounds of a number that a viewer sets, and the step of its slider; each value within the bounds is valid."""

    least: float
    greatest: float
    step: float
    unit: str


SLIDERS: Final = {
    "noise": Slider(least=0.0, greatest=1.0, step=0.05, unit="deviations of all pressures"),
    "bias": Slider(least=-3.0, greatest=3.0, step=0.1, unit="deviations of all pressures"),
    "loss": Slider(least=0.0, greatest=1.0, step=0.05, unit="of the pressure frames"),
    "delay_ms": Slider(least=0.0, greatest=200.0, step=5.0, unit="ms longer to the jets"),
}
WEIGHT: Final = Slider(least=0.0, greatest=LARGEST_WEIGHT, step=0.01, unit="")
"""Slider of every cost weight; it has the bounds of a weight in a calibration."""
_CHOICES: Final = {"controller": CONTROLLERS, "plant": PLANTS}
_SWITCHES: Final = ("enable", "babble")


@dataclass(frozen=True, kw_only=True)
class LiveSettings:
    """The settings of the running loop; `changed` accepts the result of `asdict`. `enable` is whether the vehicle wants
    control. The noise has the standard deviation `noise` on every transducer, in global deviations. The sensor `dead`
    reads Cp 0, and the sensor `biased` has the bias, in global deviations; an empty text means no sensor. `loss` is the
    share of the Pressure frames that the ECU does not receive, `delay_ms` the additional delay of jet commands. With
    `babble` a node sends continuously at the highest priority. If `weights` is None, the release's weights hold."""

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

    def changed(
        self, given: Mapping[str, Any], sensors: Sequence[str], own: Calibration, limits: CalibrationLimits
    ) -> Self:
        """Return the settings with the values in `given`; `weights` has weights by name, or None for the release's.
        `own` is the release's calibration. Raises ConfigError for an unknown name, a wrong type or value."""
        known = {item.name for item in fields(self)}
        if unknown := sorted(set(given) - known):
            raise ConfigError(f"live setting {unknown[0]!r}: must be one of {', '.join(sorted(known))}")
        values = {name: _checked(name, value, sensors) for name, value in given.items() if name != "weights"}
        if "weights" in given:
            now = replace(own, weights=self.weights or own.weights)
            weights = _weights(given["weights"], now, limits)
            values["weights"] = None if weights == own.weights else weights
        return replace(self, **values)

    @property
    def disturbances(self) -> tuple[str, ...]:
        """Texts of the disturbances that are set, without times, in a fixed order."""
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
        slider, is_number = SLIDERS[name], isinstance(value, int | float) and not isinstance(value, bool)
        # The comparison is false for NaN; infinity and very large integers are outside the bounds.
        if not (is_number and slider.least <= value <= slider.greatest):
            raise ConfigError(f"live setting {name} = {value!r}: must be in {slider.least:g}..{slider.greatest:g}")
        return float(value)
    choices = _CHOICES.get(name) or ("", *sensors)
    if value not in choices:
        names = ", ".join(item or "none" for item in choices)
        raise ConfigError(f"live setting {name} = {value!r}: must be one of {names}")
    return value


def _weights(given: Any, now: Calibration, limits: CalibrationLimits) -> CostWeights | None:
    if given is None:
        return None
    if not isinstance(given, Mapping) or (set(given) - set(TERMS)):
        raise ConfigError(f"live setting weights = {given!r}: must be an object with the names {', '.join(TERMS)}")
    return limits.changed(now, given).weights


def changes(before: LiveSettings, now: LiveSettings, own: CostWeights, controllers: Mapping[str, str]) -> Iterator[str]:
    """Yield a text for each changed setting. `own` are the release's weights, `controllers` are labels by name."""
    all_frames = "all pressure frames reach the ECU"
    percent, late = f"{100 * now.loss:g} %", f"{now.delay_ms:g} ms late"
    bias_before, bias = ((one.biased and (one.biased, one.bias)) for one in (before, now))
    rows: tuple[tuple[object, object, str, str], ...] = (
        (before.enable, now.enable, "control is requested", "the request for control is withdrawn"),
        (before.controller, now.controller, f"controller: {controllers[now.controller]}", ""),
        (before.plant, now.plant, f"plant: {now.plant}", ""),
        (before.noise, now.noise, f"noise of {now.noise:g} deviations on every sensor", "no noise on the sensors"),
        (before.dead, now.dead, f"{now.dead} is dead: it reads 0", f"{before.dead} reads the pressure again"),
        (bias_before, bias, f"{now.biased} reads {now.bias:+g} deviations wrong", f"{before.biased} has no bias"),
        (before.loss, now.loss, f"{percent} of the pressure frames do not reach the ECU", all_frames),
        (before.delay_ms, now.delay_ms, f"jet commands reach the vehicle {late}", "no delay to the jets"),
        (before.babble, now.babble, "a node babbles at the highest priority", "no node babbles"),
    )
    for old, new, set_to, unset in rows:
        if new != old:
            yield set_to if new else unset
    if now.weights != before.weights:
        was, cost = before.weights or own, now.weights or own
        changed = [f"{name} {getattr(cost, name):g}" for name in TERMS if getattr(was, name) != getattr(cost, name)]
        yield f"calibration of the cost: {', '.join(changed)}"
