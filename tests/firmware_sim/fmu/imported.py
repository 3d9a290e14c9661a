"""An FMU as fmpy imports it, with its variables by their names, and the calls that each FMU refuses."""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave


class Imported:
    _make: Any = FMU3Slave
    _token, _integer = "instantiationToken", "Int64"

    def __init__(self, path: Path, *, start: float = 0.0) -> None:
        self.description = read_model_description(str(path))
        self.variables = {item.name: item for item in self.description.modelVariables}
        folder = path.with_suffix("")
        if not folder.exists():  # a library that is loaded must not be written over
            extract(str(path), unzipdir=str(folder))
        guid, name = getattr(self.description, self._token), self.description.coSimulation.modelIdentifier
        self.fmu = self._make(guid=guid, unzipDirectory=str(folder), modelIdentifier=name, instanceName="tested")
        self.time = start
        self.fmu.instantiate(loggingOn=True)
        self.begin()

    def begin(self) -> None:
        self.fmu.enterInitializationMode(startTime=self.time)
        self.fmu.exitInitializationMode()

    def __getitem__(self, name: str) -> Any:
        return self._access("get", name, [self.variables[name].valueReference])[0]

    def __setitem__(self, name: str, value: Any) -> None:
        self._access("set", name, [self.variables[name].valueReference], [value])

    def _access(self, verb: str, name: str, *arguments: Any) -> Any:
        return getattr(self.fmu, verb + self.variables[name].type.replace("Enumeration", self._integer))(*arguments)

    @property
    def values(self) -> dict[str, Any]:
        return {name: self[name] for name in self.variables}

    def step(self, size: float) -> None:
        self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=size)
        self.time += size

    def saved(self) -> bytes:
        state = self.fmu.getFMUState()
        content = bytes(self.fmu.serializeFMUState(state))
        self.fmu.freeFMUState(state)
        return content


class Imported2(Imported):
    _make, _token, _integer = FMU2Slave, "guid", "Integer"

    def begin(self) -> None:
        self.fmu.setupExperiment(startTime=self.time)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()


def refused(capsys: Any, words: str, call: Callable[[], object]) -> None:
    """A refusal is fmi3Error (3) with a line."""
    capsys.readouterr()
    with pytest.raises(FMICallException) as caught:
        call()
    assert caught.value.status == 3, words
    (line,) = capsys.readouterr().out.splitlines()
    assert words in line


def check_order_of_calls(path: Path, given: str, gives: str, capsys: Any) -> None:
    """By FMI 3.0's state machine; a refused call changes nothing."""
    imported = Imported(path)
    fmu, variables = imported.fmu, {name: item.valueReference for name, item in imported.variables.items()}
    fmu.reset()
    period = float(imported.description.coSimulation.fixedInternalStepSize)
    refuses = partial(refused, capsys)

    def step(at: float, size: float = period) -> Any:
        return fmu.doStep(currentCommunicationPoint=at, communicationStepSize=size)

    def enter(start: float, stop: float | None = None) -> None:
        fmu.enterInitializationMode(startTime=start, stopTime=stop)

    refuses("fmi3DoStep: only", lambda: step(0.0))
    refuses("fmi3ExitInitializationMode: only", fmu.exitInitializationMode)
    refuses("fmi3Terminate: only", fmu.terminate)
    for start in (math.nan, math.inf, -math.inf, 1e300):
        refuses("startTime", partial(enter, start))
    for stop in (math.nan, 2.9):
        refuses("stopTime", partial(enter, 3.0, stop))
    fmu.setFloat64([variables[given]], [0.0])
    enter(3.0)
    refuses("fmi3EnterInitializationMode: only", lambda: enter(3.0))
    refuses("fmi3DoStep: only", lambda: step(3.0))
    fmu.exitInitializationMode()
    refuses("fmi3ExitInitializationMode: only", fmu.exitInitializationMode)
    for reference in (999, variables[gives], variables["time"]):
        refuses("no such input", partial(fmu.setFloat64, [variables[given], reference], [0.5, 0.0]))
    refuses("no such variable", lambda: fmu.getFloat64([999]))
    for value in (math.nan, math.inf):
        refuses("not a finite number", partial(fmu.setFloat64, [variables[given]], [value]))
    assert fmu.getFloat64([variables[given], variables["time"]]) == [0.0, 3.0]
    for at in (0.0, 5.0, 3.0 + period, math.nan):
        refuses("currentCommunicationPoint", partial(step, at))
    for size in (-period, math.nan, math.inf, 1e18):
        refuses("communicationStepSize", partial(step, 3.0, size))
    step(3.0)
    refuses("currentCommunicationPoint", lambda: step(3.0))
    fmu.terminate()
    refuses("fmi3DoStep: only", lambda: step(3.0 + period))
    refuses("fmi3SetFloat64: only", lambda: fmu.setFloat64([variables[given]], [0.0]))
    assert fmu.getFloat64([variables["time"]]) == [3.0 + period]
    fmu.reset()
    enter(0.0)
    fmu.exitInitializationMode()
    step(0.0)
    # fmpy's own step, by its defaults.
    simulated = simulate_fmu(str(path), stop_time=5 * period, start_values={given: 0.0}, output=[gives, "time"])
    assert simulated["time"].tolist() == [k * period for k in range(6)]
