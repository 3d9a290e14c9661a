"""A release's C, its ECU and its control step, through the bindings: as the ECU in Python, or refused in one line."""

import ctypes
import platform
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from can_bridge.bus.interface import BusHealth, BusState
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import Mode, Reason
from contract.config.controller import CostWeights
from contract.config.vehicle import E2eConfig, EcuConfig
from contract.controller.c_folder import ECU_SETTINGS, library_sources
from contract.controller.interface import ControllerError
from contract.errors import ConfigError, LibraryError
from contract.release.manifest import SpeedRange
from ecu.c.sources import firmware_sources
from ecu.ecu import Ecu
from ecu.in_c.c_ecu import CEcu, ecu_sources
from ecu.in_c.compiler import compile_c, host_compiler
from ecu.in_c.host_library import CController, open_library
from tests.each import each
from tests.ecu.in_c.exported import CONFIG, WINDOW, Exported, Feed

pytestmark = pytest.mark.compiler

FLAGS = ("-O1", "-ffp-contract=off")
INTO_CONTROL = WINDOW + 4


@pytest.fixture
def c(sources) -> CEcu:
    return CEcu(sources, flags=FLAGS)


def in_python(release: Exported, sources: dict[str, bytes]) -> Ecu:
    """Its control step is the same library's, so that plans agree to the bit as well."""
    controller = CController(library_sources(sources), release.bundle.manifest.sizes, flags=FLAGS)
    return Ecu(release.bundle, controller, CONFIG)


@pytest.fixture
def python(release, sources) -> Ecu:
    return in_python(release, sources)


def test_it_answers_and_remembers_what_the_ecu_in_python_does(c, python, sources):
    """Into control, a frame lost, one damaged, back, and out; also from a saved state, in bytes or Python's."""
    around: dict[int, dict[str, Any]] = {
        24: {"health": BusHealth(state=BusState.BUS_OFF, bus_off=1, tx_errors=256)},
        25: {"fault": Reason.INTERNAL},
        26: {"updating": True},
    }
    assert c.differing(python.state) == []
    modes, ecus = set(), [python, c]
    for period, (now_ns, frames) in enumerate(Feed().periods(27, lost=(12,), damaged=(16,))):
        if period == 17:
            by_bytes, by_value = CEcu(sources, flags=FLAGS), CEcu(sources, flags=FLAGS)
            by_bytes.restore(c.saved())
            by_value.restore(python.state)
            assert by_value.trace.action == python.trace.action
            ecus += [by_bytes, by_value]
        first, *others = [one.step(now_ns, frames, **around.get(period, {})) for one in ecus]
        assert others == [first] * len(others), period
        for one in ecus[1:]:
            assert one.differing(python.state) == one.differing(one.state) == [], period
        assert (c.trace.mode, c.trace.action) == (python.trace.mode, python.trace.action)
        assert c.trace.interventions == python.trace.interventions
        assert (c.trace.forces is None) == (python.trace.forces is None)
        assert c.status() == python.status()
        modes.add(c.trace.mode)
        assert period < INTO_CONTROL or period >= 24 or abs(c.trace.action) > 0.0
    assert {Mode.OFF, Mode.WARMUP, Mode.CONTROL, Mode.HOLD, Mode.FAULT} <= modes and c.trace.mode is Mode.OFF


@each(
    "member, value",
    [
        *(("memory.under_way[0]", -0.0), ("sensors.score[9][3]", 1e-300), ("sensors.judged", 1)),
        *(("pressures.stream", 2), ("fail_safe.lost", 2**63), ("timing.lag_ns", -1), ("has_pressures", 1)),
        ("health.is_bus_off", 1),
    ],
)
def test_a_member_that_is_planted_is_named(c, member, value):
    structs, start = c.structs, c.state
    place = structs.ffi.new("sw_ecu_state *")
    # Counts stop where C stops.
    structs.set_state(place, replace(start, missed=2**40, overruns=2**32))
    assert (place.missed, place.overruns) == (2**32 - 1, 2**32 - 1)
    structs.set_state(place, start)
    assert structs.differing(place[0], start) == []
    exec(f"state.{member} = value", {"state": place, "value": value})
    assert structs.differing(place[0], start) == [member.partition("[")[0]]


def test_it_is_calibrated_while_it_runs_as_in_python(c, python):
    """A value that is out of the limits is named and changes nothing; `tests/proofs/ecu_in_c` has all values."""
    own = c.calibration
    assert own == python.calibration
    weights = CostWeights(drag_mean=0.0, lift=5.0, smoothness=0.0)
    changed = replace(own, weights=weights, action_limit=0.01, command_step=0.01, delay_steps=2)
    for period, (now_ns, frames) in enumerate(Feed().periods(INTO_CONTROL + 6)):
        for one in (c, python) if period == INTO_CONTROL else ():
            one.calibrate(changed)
            with pytest.raises(ConfigError, match=r"action_limit = 0\.5"):
                one.calibrate(replace(own, action_limit=0.5))
            assert one.calibration == changed
        assert c.step(now_ns, frames) == python.step(now_ns, frames)
        assert c.differing(python.state) == [], period
    with pytest.raises(ValueError, match="another delay of the actuator"):
        c.restore(replace(python.state, memory=python.state.memory.with_delay(2)))
    # Damaged bytes are refused at the door, and nothing is changed; `twin_replay.c` damages each byte.
    before = c.saved()
    place = c.structs.ffi.offsetof("sw_ecu_state", "memory") + c.structs.ffi.offsetof("sw_memory", "rows")
    with pytest.raises(ValueError, match="or a number is out of range"):
        c.restore(before[:place] + b"\x7f" + before[place + 1 :])
    assert c.saved() == before


AT_SPEEDS = [1.0 + 0.03 * k for k in (*range(13), *range(12, -14, -1), *range(-13, 0))] + [None] * 30


def test_a_release_that_serves_speeds_does_as_well(release):
    """Out of the range and back at both ends, from a saved state, and until no speed is known."""
    serving = release.serving(SpeedRange(slowest=0.8, fastest=1.2))
    own = ecu_sources(serving.folder, serving.bundle, CONFIG)
    python, c, reasons = in_python(serving, own), CEcu(own, flags=FLAGS), set()
    for period, (now_ns, frames) in enumerate(Feed().driven(AT_SPEEDS)):
        if period == 8:
            c.restore(python.state)
        assert c.step(now_ns, frames) == python.step(now_ns, frames), period
        assert c.differing(python.state) == [], period
        reasons.add((python.trace.mode, python.status().reason))
    assert {(Mode.CONTROL, Reason.NONE), (Mode.WARMUP, Reason.OFF_SPEED), (Mode.FAULT, Reason.NO_SPEED)} <= reasons


def test_what_has_no_ecu_or_c_cannot_do_is_refused_in_one_line(release, sources, tmp_path):
    bare = shutil.copytree(release.folder, tmp_path / "bare")
    (bare / ECU_SETTINGS).unlink()
    with pytest.raises(LibraryError, match="has only the control step"):
        ecu_sources(bare, release.bundle, CONFIG)
    with pytest.raises(LibraryError, match=r"sw_ecu\.h is missing"):
        CEcu({name: text for name, text in sources.items() if name != "sw_ecu.h"}, flags=FLAGS)
    another = replace(release.bundle, manifest=replace(release.bundle.manifest, program_sha256="f" * 64))
    own = release.bundle.manifest.program_sha256
    with pytest.raises(LibraryError, match=rf"^[^\n]*it computes program {own[:12]}[^\n]*{'f' * 12}[^\n]*$"):
        ecu_sources(release.folder, another, CONFIG)
    check = replace(CONFIG.ecu.sensor_check, doubt_periods=2**30)
    for config, words in (
        (replace(CONFIG, ecu=replace(CONFIG.ecu, loss_window=65)), r"ecu\.loss_window"),
        (replace(CONFIG, bus=replace(CONFIG.bus, e2e=E2eConfig(window=255))), r"bus\.e2e\.window"),
        (replace(CONFIG, ecu=replace(CONFIG.ecu, sensor_check=check)), r"ecu\.sensor_check\.doubt_periods"),
        (replace(CONFIG, ecu=replace(CONFIG.ecu, hold_periods=2**29 + 1)), r"ecu\.hold_periods = 536870913"),
    ):
        with pytest.raises(ConfigError, match=words):
            ecu_sources(release.folder, release.bundle, config)


def test_without_the_check_the_numbers_of_an_estimator_are_left_out(release, tmp_path):
    """They would not compile: `sw_ecu.h` then declares no estimator."""
    folder = shutil.copytree(release.folder, tmp_path / "c")
    for name in ("sw_estimator_settings.h", "sw_estimator_weights.c"):
        (folder / name).write_text("sw_estimator_weights sw_own_estimator;\n")
    assert ecu_sources(folder, release.bundle, CONFIG) == ecu_sources(release.folder, release.bundle, CONFIG)


def test_the_largest_settings_that_are_taken_compile(release, tmp_path):
    """Sums of them have room in C's types; warnings are errors. The check is off: the release has no estimator."""
    most = 2**29
    largest = EcuConfig(hold_periods=most, decay_periods=most, rearm_frames=most, loss_window=64, deadline_window=32)
    bus = replace(CONFIG.bus, e2e=E2eConfig(window=254, min_ok=254, max_errors=253))
    contents = ecu_sources(release.folder, release.bundle, replace(CONFIG, bus=bus, ecu=largest))
    assert b"#define SW_SENSOR_CHECK 0\n" in contents[ECU_SETTINGS]
    flags = ("-shared", "-fPIC", "-fsyntax-only")
    compile_c(library_sources(contents), tmp_path / "none", compiler=host_compiler(), flags=flags)


def test_answers_may_be_written_over_what_came_and_nothing_may_have_come(c, python):
    """As its header says: the same memory for both, and NULL without frames."""
    ffi = c.structs.ffi
    for now_ns, frames in Feed().periods(INTO_CONTROL + 4, lost=(3, INTO_CONTROL + 1)):
        place = ffi.new("sw_frame[]", max(2, len(frames)))
        ffi.memmove(place, c.structs.frames(frames), len(frames) * ffi.sizeof("sw_frame"))
        assert c.lib.sw_ecu_step(c.ecu, now_ns, place if frames else ffi.NULL, len(frames), place) == 2
        assert [c.structs.frame(item) for item in place[0:2]] == python.step(now_ns, frames)
    assert c.trace.mode is Mode.CONTROL


MODE = b"#include <xmmintrin.h>\nvoid set_mode(unsigned mode); void set_mode(unsigned mode) { _mm_setcsr(mode); }\n"
PLAIN, SMALL_AS_ZERO, ROUNDING_UP = 0x1F80, 0x9FC0, 0x5F80
"""Modes of an x86 processor, for a thread."""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="modes of an x86 processor")
@each("mode", [SMALL_AS_ZERO, ROUNDING_UP])
def test_a_mode_of_the_processor_that_another_library_sets_shuts_the_jets(release, sources, mode):
    """As a library linked with -ffast-math does. The control step answers with no plan, and neither is opened."""
    c = CEcu({**sources, "mode.c": MODE}, flags=FLAGS)
    c.structs.ffi.cdef("void set_mode(unsigned mode);")
    set_mode, periods = c.lib.set_mode, Feed().periods(INTO_CONTROL + 8)
    controller = CController(library_sources(sources), release.bundle.manifest.sizes, flags=FLAGS)
    inputs = np.zeros((WINDOW, 5)), np.zeros(8), np.ones(8)
    modes = []
    for period, (now_ns, frames) in enumerate(periods):
        set_mode(mode if period >= INTO_CONTROL + 4 else PLAIN)
        try:
            command = c.step(now_ns, frames)[0]
            if period >= INTO_CONTROL + 4:
                with pytest.raises(ControllerError, match="status 2: this build, or the processor's mode"):
                    controller.control_step(*inputs)
                with pytest.raises(LibraryError, match=r"refuses|does not run"):
                    CEcu(sources, flags=FLAGS)
                with pytest.raises(LibraryError, match=r"refuses|does not run"):
                    CController(library_sources(sources), release.bundle.manifest.sizes, flags=FLAGS)
        finally:
            set_mode(PLAIN)
        modes.append(c.trace.mode)
    assert modes[INTO_CONTROL + 3] is Mode.CONTROL
    assert modes[INTO_CONTROL + 4 :] == [Mode.FAULT] * 4 and c.status().reason is Reason.INTERNAL
    parsed = message_set(CONFIG.bus).command.parse(command.data)
    assert parsed is not None and (parsed.enable, parsed.flow_m2_per_s) == (False, 0.0)
    controller.control_step(*inputs)


def test_a_step_that_answers_otherwise_than_the_exporters_is_refused_at_power_on(release, sources):
    """Where sums are right and a weight has changed, or a loop stops short: to the bit, and where the step is fused."""
    (weight,) = re.findall(rb"\.dyn1_rows = \{(-?\d+)", sources["sw_weights.c"])
    start = b".dyn1_rows = {"
    changed = sources["sw_weights.c"].replace(start + weight, start + (b"-127" if int(weight) > 0 else b"127"))
    short = sources["sw_cost.c"].replace(b"k < SW_HORIZON", b"k + 1 < SW_HORIZON", 1)
    fused, around = ("-O2", "-march=native", "-ffp-contract=fast"), {Path(name).name for name in firmware_sources()}
    for file, planted, status in (("sw_weights.c", changed, 2), ("sw_cost.c", short, 2), ("sw_cost.c", b"", 0)):
        given = sources | ({file: planted} if planted else {})
        own = {name: text for name, text in library_sources(given).items() if name not in around}
        step = CController(own, release.bundle.manifest.sizes, flags=fused)
        place, asked, found = step._workspace.ctypes.data, step._input, step._output
        answer = step._library.sw_known_answer(ctypes.c_void_p(place), ctypes.byref(asked), ctypes.byref(found))
        assert answer == status, file
        if status:
            with pytest.raises(LibraryError, match=r"refuses|does not run"):
                CEcu(given, flags=FLAGS)
    # Decisions may not be fused: tests/export/to_c/test_arithmetic.py has what the check answers where they are.
    inexact = b'#include "sw_ecu_parts.h"\nuint8_t sw_inexact(void) { return SW_REASON_INTERNAL; }\n'
    with pytest.raises(LibraryError, match=r"^the compiled ECU does not run: -O1 .*-ffp-contract=off$"):
        CEcu(sources | {"sw_inexact.c": inexact}, flags=FLAGS)
    without = {"sw_ecu.c": b"#define SW_WITHOUT_KNOWN_ANSWER\n" + sources["sw_ecu.c"]}
    c = CEcu(sources | without | {"sw_weights.c": changed}, flags=FLAGS)
    c.ecu.unfit = Reason.INTERNAL
    for now_ns, frames in Feed().periods(INTO_CONTROL + 4):
        c.step(now_ns, frames)
        assert c.trace.mode is Mode.FAULT and c.status().reason is Reason.INTERNAL


@each(
    "file, old, new, words",
    [
        ("sw_settings.h", "#define SW_HORIZON 8", "#define SW_HORIZON 9", "its sizes are not the program's sizes"),
        ("sw_settings.h", "#define SW_DBC_SHA256", '#define SW_DBC_SHA256 "0" //', "another stillwake.dbc"),
        ("sw_settings.h", "#define SW_PRECISION", "#define SW_PRECISE", "SW_PRECISION is missing"),
        ("sw_cost.c", "#include", "#error broken\n#include", "broken"),
    ],
)
def test_an_altered_library_is_refused_in_one_line(release, tmp_path, file, old, new, words):
    folder = tmp_path / "c"
    shutil.copytree(release.folder, folder, dirs_exist_ok=True)
    source = (folder / file).read_text()
    assert old in source
    (folder / file).write_text(source.replace(old, new, 1))
    with pytest.raises(LibraryError, match=words) as refusal:
        open_library(folder, release.bundle, flags=("-O0", "-fsyntax-only"))
    assert "\n" not in str(refusal.value)
