"""The layout that cffi reads from the header is the compiler's, and a field that differs is named."""

import ctypes
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from can_bridge.bus.interface import BusHealth, BusState
from can_bridge.e2e.receiver import Check, ReceiverState, StreamState
from contract.errors import LibraryError
from contract.release.manifest import SpeedRange
from firmware_sim.ecu.controller_memory import Past
from firmware_sim.ecu.ecu_state import EcuState
from firmware_sim.ecu.speed_reception import SpeedState
from firmware_sim.in_c.c_ecu import ecu_sources
from firmware_sim.in_c.c_structs import Structs, differing, flattened
from firmware_sim.in_c.compiler import compile_c, host_compiler
from tests.each import each
from tests.firmware_sim.ecu_in_c import CONFIG, WINDOW, Exported, exported

try:
    host_compiler()
except LibraryError as error:
    pytest.skip(str(error), allow_module_level=True)

pytestmark = pytest.mark.compiler

PLACES = (
    ("sw_ecu", "surroundings"),
    ("sw_ecu", "calibration"),
    ("sw_ecu", "trace"),
    ("sw_ecu", "input"),
    ("sw_ecu", "output"),
    ("sw_ecu_state", "sensors"),
    ("sw_ecu_state", "timing"),
    ("sw_ecu_state", "pressure_ns"),
    ("sw_ecu_state", "health"),
    ("sw_memory", "under_way"),
    ("sw_frame", "data"),
)


@pytest.fixture(scope="module")
def release(tmp_path_factory) -> Exported:
    return exported(tmp_path_factory.mktemp("structs"))


@pytest.fixture(scope="module")
def sources(release) -> dict[str, bytes]:
    return ecu_sources(release.folder, release.bundle, CONFIG)


@pytest.fixture(scope="module")
def structs(sources) -> Structs:
    return Structs(sources, host_compiler())


@pytest.fixture
def start() -> EcuState:
    return EcuState.power_on(window=WINDOW, sensors=4, horizon=8, delay=CONFIG.ecu.frozen_actions)


def test_members_stand_where_the_compiler_puts_them(sources, structs, tmp_path: Path):
    """In the header as it is, with the whole workspace."""
    lines = [f"offsetof({struct}, {member})" for struct, member in PLACES]
    lines += ["sizeof(sw_frame)", "sizeof(sw_ecu_state)"]
    shim = f'#include "sw_ecu.h"\nextern const size_t places[];\nconst size_t places[] = {{{", ".join(lines)}}};\n'
    headers = {name: text for name, text in sources.items() if name.endswith(".h")}
    library = tmp_path / "places.so"
    compile_c(headers | {"shim.c": shim.encode()}, library, compiler=host_compiler(), flags=("-fPIC", "-shared"))
    places = list((ctypes.c_size_t * len(lines)).in_dll(ctypes.CDLL(str(library)), "places"))
    expected = [structs.ffi.offsetof(*place) for place in PLACES]
    assert places == [*expected, structs.size("sw_frame"), structs.size("sw_ecu_state")]


def some_state(start: EcuState, seed: int) -> EcuState:
    """With another value in nearly every field than at power-on."""
    rng = np.random.default_rng(seed)
    sensors, memory = start.sensors, start.memory

    def like(array: np.ndarray) -> np.ndarray:
        return rng.normal(size=array.shape)

    return replace(
        start,
        memory=replace(
            memory,
            window=like(memory.window),
            rows=3,
            gap=2,
            plan=like(memory.plan).astype(np.float32).astype(float),
            under_way=memory.under_way.pushed(-0.0),
        ),
        sensors=replace(
            sensors,
            **{name: like(getattr(sensors, name)) for name in ("residual", "fast", "slow", "noise", "score")},
            readings=like(sensors.readings),
            estimates=like(sensors.estimates),
            flat=np.array([1.0, 2.0, 3.0, 4.0]),
            set_aside=2,
            doubt=7,
            implausible=True,
        ),
        timing=replace(start.timing, step_ns=2**61, lag_ns=-5, off_time=9, skipped=1),
        health=BusHealth(state=BusState.BUS_OFF, tx_errors=256, rx_errors=1, bus_off=3),
        pressure_ns=77,
        pressure_counter=13,
        overruns=4,
        missed=5,
    )


def at_speeds(state: EcuState, past: int) -> EcuState:
    """The same of a release that serves a range of speeds."""
    rng = np.random.default_rng(0)
    receiver = ReceiverState(stream=StreamState.VALID, last_counter=3, window=(Check.OK, Check.ERROR), counts=(1,) * 6)
    speed = SpeedState(ratio=0.9, density=1.1, measured_ns=-5, is_off=True, receiver=receiver)
    kept = Past(rows=rng.normal(size=(past, 5)), speeds=rng.uniform(0.5, 2.0, past), count=2)
    sensors = replace(state.sensors, estimates=rng.normal(size=(past, 4)))
    return replace(state, speed=speed, sensors=sensors, memory=replace(state.memory, past=kept))


def test_a_state_is_the_same_after_a_stay_in_c(release, structs, start):
    """All of its fields: none is left out of the comparison but what C does not have. Counts stop where C stops."""
    serving = release.serving(SpeedRange(slowest=0.5, fastest=2.0))
    at_any = Structs(ecu_sources(serving.folder, serving.bundle, CONFIG), host_compiler())
    changed = at_speeds(some_state(start, 3), serving.bundle.manifest.past)
    for known, state in [(structs, some_state(start, seed)) for seed in range(3)] + [(at_any, changed)]:
        structs, place = known, known.ffi.new("sw_ecu_state *")
        structs.set_state(place, state)
        read = structs.state(place[0])
        assert differing(read, state) == []
        before, after = flattened(state), flattened(read)
        assert [name for name in before if not np.array_equal(before[name], after[name])] == []
    state = replace(changed, missed=2**40, overruns=2**32)
    structs.set_state(place, state)
    assert (place.missed, place.overruns) == (2**32 - 1, 2**32 - 1)
    assert differing(structs.state(place[0]), state) == []


@each(
    "member, value, name",
    [
        ("memory.under_way[0]", -0.0, "memory.under_way"),
        ("sensors.score[9][3]", 1e-300, "sensors.score"),
        ("sensors.judged", 1, "sensors.residual"),
        ("pressures.stream", 2, "pressures.stream"),
        ("fail_safe.lost", 2**63, "fail_safe.lost"),
        ("timing.lag_ns", -1, "timing.lag_ns"),
        ("has_pressures", 1, "pressure_ns"),
        ("health.is_bus_off", 1, "health.state"),
    ],
)
def test_a_member_that_is_planted_is_named(structs, start, member, value, name):
    place = structs.ffi.new("sw_ecu_state *")
    structs.set_state(place, start)
    assert differing(structs.state(place[0]), start) == []
    exec(f"state.{member} = value", {"state": place, "value": value})
    assert name in differing(structs.state(place[0]), start)
