"""The ECU's FMU for FMI 2.0 and for Windows, by the reader, importer and tools of others."""

import io
import re
import zipfile
from typing import Any

import pytest
from fmpy import simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

from tests.firmware_sim.fmu.imported import Imported, Imported2
from tests.firmware_sim.fmu.test_ecu_fmu import PERIOD_S, swinging

pytestmark = pytest.mark.compiler


def test_by_fmi_2_it_is_the_same_ecu(fmu_of, capsys):
    path, _ = fmu_of(fmi2=True)
    assert validate_fmu(str(path)) == []
    second, third, states = Imported2(path, start=3.0), Imported(fmu_of()[0], start=3.0), list[Any]()
    for k in range(12):
        for imported in (second, third):
            swinging(imported, k)
            imported.step(PERIOD_S)
        assert second.values == third.values
        states.append(second.fmu.serializeFMUstate(second.fmu.getFMUstate()))
    assert second["flow_command"] != 0.0
    second.fmu.setFMUstate(second.fmu.deSerializeFMUstate(states[10]))
    second.time -= PERIOD_S
    swinging(second, 11)
    second.step(PERIOD_S)
    assert second["flow_command"] == third["flow_command"]
    capsys.readouterr()
    with pytest.raises(FMICallException):
        second.step(-PERIOD_S)
    assert "communicationStepSize" in capsys.readouterr().out
    with pytest.raises(FMICallException):
        second["flow_command"] = 1.0
    assert "fmi2SetFloat64: a value reference is of no such input" in capsys.readouterr().out
    second.fmu.reset()
    second.time = 0.0
    second.begin()
    again = Imported2(path)
    for imported in (second, again):
        imported.step(PERIOD_S)
    assert second.fmu.serializeFMUstate(second.fmu.getFMUstate()) == again.fmu.serializeFMUstate(
        again.fmu.getFMUstate()
    )
    simulated = simulate_fmu(str(path), stop_time=0.1, start_values={"pressure_age": 0.001}, output=["mode"])
    assert simulated["time"].tolist() == [k * PERIOD_S for k in range(6)]


@pytest.mark.proofs  # ziglang compiles its C library for Windows first
def test_for_windows_it_exports_the_standards_functions_and_needs_nothing_but_windows(fmu_of):
    pytest.importorskip("ziglang", reason="ziglang (extra mcu) is not installed")
    pefile = pytest.importorskip("pefile", reason="pefile is not installed")
    for importer, prefix, place, kinds in (
        (FMU3Slave, "fmi3", "x86_64-windows", {"bus": True}),
        (FMU2Slave, "fmi2", "win64", {"fmi2": True}),
    ):
        with zipfile.ZipFile(io.BytesIO(fmu_of(windows=True, **kinds)[0].read_bytes())) as archive:
            image = pefile.PE(data=archive.read(f"binaries/{place}/stillwake_ecu.dll"))
        exported = {one.name.decode() for one in image.DIRECTORY_ENTRY_EXPORT.symbols}
        called = {name for name in dir(importer) if re.match(prefix + "[A-Z]", name)}
        assert called <= exported, called - exported
        needed = {one.dll.decode().lower() for one in image.DIRECTORY_ENTRY_IMPORT}
        assert all(name == "kernel32.dll" or name.startswith("api-ms-win-crt-") for name in needed), needed
