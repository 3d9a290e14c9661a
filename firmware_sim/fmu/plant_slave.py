"""The plant as a slave of FMI 3.0: `pythonfmu3` copies this file into the FMU and runs it in the importing tool's
Python.

The first control period begins at the start time, and the others follow without gaps. In each period, the jets ramp
from their present flow to the flow requested at the period's start, and the inflow ramps to the vehicle's speed in the
same way. A communication step computes the periods that end in it. The outputs are the values after the latest period.

Invalid calls are refused before they reach this class (`ecu/c/fmu/plant`).
"""

import json
from functools import partial
from pathlib import Path
from typing import Any

from pythonfmu3 import (
    DefaultExperiment,
    Float64,
    Fmi3Causality,
    Fmi3Slave,
    Fmi3Status,
    Fmi3StepResult,
    Fmi3Variability,
    Unit,
)

from contract.config.loading import from_tree
from contract.errors import StillwakeError
from wake.plants import own_wake

SETTINGS = "settings.json"
START = "start.npz"
_SAME_S = 1e-6  # largest difference in s of two times that are treated as equal
_OWN = ("time", "jet_flow", "vehicle_speed", "_speed", "_start", "_done", "_asked")


class StillwakePlant(Fmi3Slave):  # type: ignore[misc]
    """The wake of `stillwake run`, from its initial state on, with inputs and outputs in engineering units. The folder
    `resources` has `SETTINGS`, a whole configuration, and optionally `START`, the initial flow state."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._made_with = kwargs
        self.description = "The flow around the truck, or another body, with its two jets"
        self.license = "MIT"
        folder = Path(self.resources)
        self._config = config = from_tree(json.loads((folder / SETTINGS).read_text(encoding="utf-8")))
        self._wake = own_wake(config, start=folder / START if (folder / START).is_file() else None)
        self._sample = self._wake.sample()
        self.time, self.jet_flow, self.vehicle_speed = 0.0, 0.0, config.operating_point.speed
        self.default_experiment = DefaultExperiment(start_time=0.0, step_size=config.period_ns / 1e9)
        self._speed = self.vehicle_speed  # present speed of the inflow, m/s
        self._start: float | None = None
        self._done = 0  # number of control periods computed
        self._asked: tuple[float, float] | None = None  # (jet flow, speed) of the period that has begun
        pressure = config.operating_point.dynamic_pressure
        self.register_units([Unit("Pa", kg=1, m=-1, s=-2), Unit("m/s", m=1, s=-1), Unit("m2/s", m=2, s=-1)])
        self.register_units([Unit("s", s=1), Unit("t_c")])
        given, gives = Fmi3Causality.input, Fmi3Causality.output
        self._add("time", "Time", "s", Fmi3Causality.independent, lambda: self.time)
        self._add("jet_flow", "Jet flow rate per unit span to be reached at the end of a step", "m2/s", given)
        self._add("vehicle_speed", "Speed through the air to be reached at the end of a step", "m/s", given)
        for i, name in enumerate(self._wake.layout.names):
            what = "Wall pressure, relative to the free stream"
            self._add(f"pressure.{name}", what, "Pa", gives, lambda i=i: self._sample.Cp[i] * pressure)
        for name, field, unit, what in (
            ("Cd", "Cd", None, "Drag coefficient of the wall, at the speed of the operating point"),
            ("Cd_net", "Cd_net", None, "Cd with the force on the slots and the jets' momentum"),
            ("Cl", "Cl", None, "Lift coefficient, at the speed of the operating point"),
            ("convective_time", "t", "t_c", "Time in units of width / speed"),
        ):
            self._add(name, what, unit, gives, lambda field=field: getattr(self._sample, field))

    def _add(self, name: str, description: str, unit: str | None, causality: Fmi3Causality, getter: Any = None) -> None:
        facts = {"description": description, "unit": unit, "getter": getter, "causality": causality}
        self.register_variable(Float64(name, variability=Fmi3Variability.continuous, **facts), nested=False)

    def do_step(self, current_time: float, step_size: float) -> Fmi3StepResult:
        """Compute all control periods that end in this step."""
        if self._start is None:
            self._start = current_time
        period_s, self.time = self._config.period_ns / 1e9, current_time + step_size
        try:
            while True:
                begins = self._start + self._done * period_s
                if self._asked is None and begins < self.time - _SAME_S:
                    self._asked = (self.jet_flow, self.vehicle_speed)
                if self._asked is None or begins + period_s > self.time + _SAME_S:
                    return Fmi3StepResult()
                self._advance(*self._asked)
                self._done, self._asked = self._done + 1, None
        except StillwakeError as error:
            self.log(str(error), Fmi3Status.error)
            return Fmi3StepResult(status=Fmi3Status.error)

    def _advance(self, flow: float, after: float) -> None:
        config, point, before = self._config, self._config.operating_point, self._speed
        if (before, after) == (point.speed, point.speed):
            self._wake.wind = None
        else:
            begin, length = self._wake.t, config.flow.control_period
            self._wake.wind = lambda t: (before + (after - before) * (t - begin) / length) / point.speed - 1.0
        limit = config.flow.action_limit
        self._sample = self._wake.advance(min(max(flow / point.flow_rate_scale, -limit), limit))
        self._speed = after

    def __reduce__(self) -> tuple[Any, ...]:
        # The getters of the outputs are bound to this object, so a copy must call the constructor for its own getters.
        return partial(StillwakePlant, **self._made_with), (), self._get_fmu_state()

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._set_fmu_state(state)

    def _get_fmu_state(self) -> dict[str, Any]:
        """Return the state for `_set_fmu_state`. It can be stored only in memory, not in a file."""
        return {"wake": self._wake.state(), "own": {name: getattr(self, name) for name in _OWN}}

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        self._sample = self._wake.reset(state["wake"])
        for name, value in state["own"].items():
            setattr(self, name, value)
