"""An FMU as fmpy imports it, with its variables by their names."""

from pathlib import Path
from typing import Any

from fmpy import extract, read_model_description
from fmpy.fmi3 import FMU3Slave


class Imported:
    """One instance, initialised at a time."""

    def __init__(self, path: Path, *, start: float = 0.0) -> None:
        self.description = read_model_description(str(path))
        self.variables = {item.name: item for item in self.description.modelVariables}
        folder = path.with_suffix("")
        if not folder.exists():  # a library that is loaded must not be written over
            extract(str(path), unzipdir=str(folder))
        self.fmu: Any = FMU3Slave(
            guid=self.description.instantiationToken,
            unzipDirectory=str(folder),
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName="tested",
        )
        self.time = start
        self.fmu.instantiate()
        self.fmu.enterInitializationMode(startTime=start)
        self.fmu.exitInitializationMode()

    def __getitem__(self, name: str) -> Any:
        return self._access("get", name, [self.variables[name].valueReference])[0]

    def __setitem__(self, name: str, value: Any) -> None:
        self._access("set", name, [self.variables[name].valueReference], [value])

    def _access(self, verb: str, name: str, *arguments: Any) -> Any:
        kind = self.variables[name].type.replace("Enumeration", "Int64")
        return getattr(self.fmu, verb + kind)(*arguments)

    def step(self, size: float) -> None:
        """A communication step."""
        self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=size)
        self.time += size

    def saved(self) -> bytes:
        """The state, serialised."""
        state = self.fmu.getFMUState()
        content = bytes(self.fmu.serializeFMUState(state))
        self.fmu.freeFMUState(state)
        return content
