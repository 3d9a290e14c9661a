"""The ECU's FMU, imported by another library: a sound file, the ECU in C to the bit; for FMI 2.0 and Windows, too."""

import io
import math
import re
import zipfile
from collections.abc import Callable
from functools import partial
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

from can_bridge.e2e.profiles import E2eSender
from can_bridge.wire.message_sets import MessageSet, message_set
from can_bridge.wire.messages import Mode, Pressure, Reason, VehicleSpeed
from contract.release.manifest import SpeedRange
from ecu.in_c.c_ecu import CEcu
from ecu.in_c.compiler import host_compiler
from firmware_sim.fmu.fmu_files import FLAGS
from tests.ecu.in_c.exported import CONFIG, Exported
from tests.firmware_sim.fmu.imported import Imported, Imported2, check_order_of_calls

pytestmark = pytest.mark.compiler
PERIOD_S = CONFIG.period_ns / 1e9
OTHER_TYPES = ("Float32", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Boolean", "String")
ODD: dict[str, tuple[float, ...]] = {
    "pressure.": (5e3, -9e9, 0.25),
    "valid.": (False,),
    "pressure_age": (0.0, -1.0, 0.0049999, 0.0300001, 0.0651, 0.08, 3.0),
    "vehicle_speed": (24.9976, -1.0, 400.0),
    "air_density": (1.234, 1.235, 3.0),
    "send_": (False,),
}
"""What variables are from time to time, within the wire's range and beyond it."""


@pytest.fixture(scope="module")
def release(release) -> Exported:
    return release.serving(SpeedRange(slowest=0.6, fastest=1.4))


def test_the_file_is_sound_the_same_again_and_compiles_from_its_own_sources(fmu_of, shared_builds, tmp_path):
    path, _ = fmu_of()
    assert validate_fmu(str(path)) == []
    assert path.read_bytes() == fmu_of()[0].read_bytes()
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    built = ElementTree.parse(tmp_path / "sources/buildDescription.xml")
    named = {item.get("name") for item in built.iter("SourceFile")}
    files = {item.name: item.read_bytes() for item in (tmp_path / "sources").iterdir()}
    assert named == {name for name in files if name.endswith(".c")}
    shared_builds.quick(files, tmp_path / "again.so", compiler=host_compiler(), flags=FLAGS)
    assert (tmp_path / "again.so").read_bytes() == next((tmp_path / "binaries").rglob("*.so")).read_bytes()


def frames_of_a_vehicle(values: dict[str, float], messages: MessageSet, senders: list[E2eSender], now_ns: int):
    """Clipped and invalid, or unknown, where the wire has no room, as of the bench's `VehicleNode`."""
    pascal, sound = (
        np.array([values[name] for name in values if name.startswith(kind)]) for kind in ODD if "." in kind
    )
    limit, age, density = messages.pressure_limit_pa, values["pressure_age"], values["air_density"]
    pressure = Pressure(
        pressure_pa=tuple(np.clip(pascal, -limit, limit).tolist()),
        valid=tuple((sound & (np.abs(pascal) <= limit)).tolist()),
        enable_request=bool(values["enable_request"]),
        age_ns=round(1e9 * min(max(age, 0.0), 0.65535)),
    )
    speed = values["vehicle_speed"] if 0.0 <= values["vehicle_speed"] < 327.6 else None
    motion = VehicleSpeed(speed_m_per_s=speed, age_ns=0, density_kg_per_m3=density if 0.005 < density <= 2.55 else None)
    if values["send_pressures"]:
        yield senders[0].frame(messages.pressure.emit(pressure), now_ns=now_ns)
    if values["send_speed"]:
        yield senders[1].frame(messages.speed.emit(motion), now_ns=now_ns)


def test_behind_its_variables_the_ecu_gets_the_frames_of_a_vehicle(release, fmu_of):
    """Compared are the outputs, and the ECU's whole state."""
    path, sources = fmu_of()
    imported, rng = Imported(path, start=3.0), np.random.default_rng(7)
    ecu, messages = CEcu(sources, flags=("-O1", "-ffp-contract=off")), message_set(CONFIG.bus)
    senders, modes, reasons = [E2eSender(spec) for spec in messages.specs[:2]], set(), set()
    for k in range(400):
        pascal = 0.3 * CONFIG.operating_point.dynamic_pressure * np.sin(0.3 * k + np.arange(4))
        values = {f"pressure.{name}": pascal[i] for i, name in enumerate(release.bundle.manifest.sensors)}
        values |= {f"valid.{name}": True for name in release.bundle.manifest.sensors}
        values |= {"enable_request": k > 0 and k % 40 != 39, "pressure_age": 0.004, "air_density": 0.0}
        values |= {"vehicle_speed": 25.0 - 0.1 * min(max(k - 150, 0), 120) if k < 340 else -1.0}
        values |= {"send_pressures": True, "send_speed": True}
        for name in values:
            odd = next((odd for kind, odd in ODD.items() if name.startswith(kind)), ())
            if odd and k > 30 and rng.random() < 0.02:
                values[name] = odd[rng.integers(len(odd))]
            imported[name] = values[name]
        imported.step(PERIOD_S)
        now_ns = k * CONFIG.period_ns
        answers = ecu.step(now_ns, list(frames_of_a_vehicle(values, messages, senders, now_ns)))
        assert imported.saved().endswith(ecu.saved()), k
        command, status = messages.command.parse(answers[0].data), messages.status.parse(answers[1].data)
        assert command is not None and status is not None
        modes.add(command.mode)
        reasons.add(status.reason)
        outputs = {name: getattr(status, name) for name in ("reason", "overruns", "missed", "crc_errors", "refused")}
        outputs |= {name: getattr(command, name) for name in ("enable", "next_period", "mode")}
        outputs |= {"flow_command": command.flow_m2_per_s}
        assert {name: imported[name] for name in outputs} == outputs, k
    assert {Mode.CONTROL, Mode.HOLD, Mode.DECAY, Mode.WARMUP} <= modes
    assert {Reason.STALE, Reason.SENSOR_INVALID, Reason.OFF_SPEED, Reason.NO_SPEED} <= reasons


def swinging(imported: Imported, k: int) -> None:
    for i in range(4):
        name = list(imported.variables)[1 + i]
        imported[name] = 0.3 * CONFIG.operating_point.dynamic_pressure * math.sin(0.3 * k + i)
    imported["enable_request"] = k > 0


def test_a_step_of_any_length_has_the_control_periods_that_begin_in_it(fmu_of):
    path, _ = fmu_of()
    whole, parts, pairs = Imported(path), Imported(path), Imported(path)
    for k in range(12):
        for imported in (whole, parts, pairs) if k % 2 == 0 else (whole, parts):
            swinging(imported, k - k % 2)
        whole.step(PERIOD_S)
        for share in (0.25, 0.75):
            parts.step(share * PERIOD_S)
        if k % 2:
            pairs.step(2 * PERIOD_S)
    assert whole["mode"] == Mode.CONTROL
    assert whole["flow_command"] == parts["flow_command"] == pairs["flow_command"] != 0.0


def test_a_state_is_gone_back_to_in_memory_or_by_its_bytes_and_another_fmus_refused(fmu_of):
    path, _ = fmu_of()
    imported, found = Imported(path), []
    for k in range(8):
        swinging(imported, k)
        imported.step(PERIOD_S)
    state, content, at = imported.fmu.getFMUState(), imported.saved(), imported.time
    other = Imported(path)
    for way in (state, imported.fmu.deserializeFMUState(content)):
        for again in (imported, other):
            again.fmu.setFMUState(way)
            again.time = at
            again.step(PERIOD_S)
            found.append(again.saved())
    assert found == [found[0]] * 4 != [content] * 4
    for damaged in (content[:-1], b"x" + content[1:], bytes(len(content))):
        with pytest.raises(FMICallException):
            imported.fmu.setFMUState(imported.fmu.deserializeFMUState(damaged))
    for call in (imported.fmu.setFMUState, imported.fmu.serializeFMUState):
        with pytest.raises(FMICallException):
            call(None)
    assert imported.saved() == found[0]
    imported.fmu.reset()
    imported.time = 0.0
    imported.begin()
    assert imported.saved() == Imported(path).saved()


def test_calls_out_of_order_or_of_what_it_does_not_have_are_refused_and_fmpys_own_step_is_served(fmu_of, capsys):
    path, _ = fmu_of()
    check_order_of_calls(path, "pressure_age", "flow_command", capsys)
    imported = Imported(path)
    outputs = [imported.variables["flow_command"].valueReference]
    calls: tuple[Callable[[], object], ...] = (
        *(partial(getattr(imported.fmu, f"get{kind}"), outputs) for kind in OTHER_TYPES),
        *(partial(getattr(imported.fmu, f"set{kind}"), outputs, [1]) for kind in OTHER_TYPES[:-1]),
        imported.fmu.enterEventMode,
    )
    for call in calls:
        with pytest.raises(FMICallException):
            call()
    assert imported.fmu.fmi3GetVersion() == b"3.0"
    with pytest.raises(Exception, match="instantiate"):
        imported.fmu.instantiate(eventModeUsed=True)
    times = np.arange(9) * PERIOD_S
    rows = np.array([(t, t > 0.0) for t in times], dtype=[("time", float), ("enable_request", bool)])
    steps = {"stop_time": times[-1], "step_size": PERIOD_S, "output_interval": PERIOD_S}
    simulated = simulate_fmu(str(path), input=rows, output=["mode", "time"], **steps)
    assert simulated["mode"].tolist()[-1] == Mode.CONTROL


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
    saved = [one.fmu.serializeFMUstate(one.fmu.getFMUstate()) for one in (second, again)]
    assert saved[0] == saved[1]
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
