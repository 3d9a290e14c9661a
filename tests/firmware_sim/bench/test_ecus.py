"""One run with each ECU: the same commands from all, virtual time by the core's cycles, and what the run says of it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import JET_COMMAND
from can_bridge.wire.messages import Mode
from contract.controller.c_folder import library_sources
from contract.errors import ConfigError
from firmware_sim.bench.ecus import CORTEX_M7, C, loop_ecu
from firmware_sim.bench.lockstep import Lockstep
from firmware_sim.bench.simulation import Simulation
from firmware_sim.bench.spans import Spans
from firmware_sim.ecu.stepped import LoopEcu
from firmware_sim.in_c.c_ecu import CEcu, ecu_sources
from firmware_sim.in_c.compiler import zig_compiler
from firmware_sim.in_c.host_library import CController
from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.run_tables import service_rows
from firmware_sim.runs.summary import summary
from tests.each import each
from tests.firmware_sim.bench.harness import LiveOscillator
from tests.firmware_sim.ecu_in_c import CONFIG, Exported, exported
from wake.plants import open_plant

pytestmark = [pytest.mark.compiler, pytest.mark.usefixtures("no_pictures")]
pytest.importorskip("ziglang", reason="ziglang (extra mcu) is not installed")

SPANS = Spans(lead_in=1.0, controlled=4.0, settle=0.0, averages=False)
ZIG = (*("-O3", "-ffp-contract=on", "-g0"), "-march=native")
PERIOD_NS = CONFIG.period_ns
RESET = "reset@0.2"


@pytest.fixture(scope="module")
def release(tmp_path_factory) -> Exported:
    return exported(tmp_path_factory.mktemp("ecus"))


@pytest.fixture(scope="module")
def sources(release) -> dict[str, bytes]:
    return ecu_sources(release.folder, release.bundle, CONFIG)


def run(release: Exported, ecu: LoopEcu | None, controller=None, *faults: str) -> tuple[RunLog, list[Frame]]:
    from firmware_sim.bench.disturbances import Disturbances

    captured: list[Frame] = []
    simulation = Simulation(
        release.bundle,
        CONFIG,
        spans=SPANS,
        ecu=ecu,
        controller=controller,
        disturbances=Disturbances.parse(faults),
    )
    return simulation.run(LiveOscillator(CONFIG), capture=captured.append), captured


def host(sources) -> LoopEcu:
    return LoopEcu(ecu=CEcu(sources, compiler=zig_compiler(), flags=ZIG), kind=C, computed_by="a test")


def of_the_library(release: Exported, sources) -> CController:
    """The control step of the same sources, for the ECU in Python."""
    sizes = release.bundle.manifest.sizes
    return CController(library_sources(sources), sizes, compiler=zig_compiler(), flags=ZIG)


def test_the_ecu_in_c_gives_the_run_of_the_one_in_python(release, sources):
    """Frame by frame, their times included: the control step is the same library's in both."""
    by_python, expected = run(release, None, of_the_library(release, sources))
    by_c, found = run(release, host(sources))
    assert found == expected
    np.testing.assert_array_equal(by_c.series["Cd"], by_python.series["Cd"])
    assert by_c.metadata.status == by_python.metadata.status
    assert Mode.CONTROL in by_c.series["mode"]
    assert (by_python.metadata.ecu.kind, by_c.metadata.ecu.kind) == ("python", "c")
    assert by_c.metadata.ecu.modelled_ms is None


def test_a_reset_takes_its_state(release, sources):
    """As it takes that of the ECU in Python: counters begin anew, and so does all that follows."""
    _, expected = run(release, None, of_the_library(release, sources), RESET)
    _, found = run(release, host(sources), None, RESET)
    assert found == expected
    counters = [frame.data[2] for frame in found if frame.frame_id == JET_COMMAND.frame_id]
    assert counters.count(0) == 2


@pytest.mark.mcu
def test_the_core_drives_the_loop_in_its_own_time(release, sources):
    pytest.importorskip("unicorn", reason="unicorn (extra mcu) is not installed")
    _, expected = run(release, host(sources))
    core = loop_ecu(CORTEX_M7, sources, clock_mhz=480.0)
    log, found = run(release, core)

    def commands(frames: list[Frame]) -> list[bytes]:
        return [frame.data for frame in frames if frame.frame_id == JET_COMMAND.frame_id]

    assert commands(found) == commands(expected)
    ecu = log.metadata.ecu
    assert (ecu.kind, ecu.clock_mhz) == ("cortex-m7", 480.0)
    assert ecu.modelled_ms is not None
    assert ecu.modelled_ms_max is not None
    assert 0.0 < ecu.modelled_ms <= ecu.modelled_ms_max < CONFIG.ecu.compute_time_ms
    assert summary(log)["ecu"]["modelled_ms"] == ecu.modelled_ms
    rows = dict(service_rows(log))
    assert rows["ECU"] == "in C, on an emulated Cortex-M7 at 480 MHz"
    assert f"{ecu.modelled_ms:.2f} / {ecu.modelled_ms_max:.2f} ms" in rows["virtual compute time"]
    assert rows["virtual compute time"].endswith("fits")
    # The setting says 8 ms; a step of this small program takes less, so its commands are on the bus sooner.
    earlier = [
        later.timestamp_ns - sooner.timestamp_ns
        for sooner, later in zip(found, expected, strict=True)
        if sooner.frame_id == JET_COMMAND.frame_id
    ]
    charged = round((CONFIG.ecu.compute_time_ms - ecu.modelled_ms) * 1e6)
    assert max(earlier) > charged
    assert min(abs(gain - charged) for gain in earlier) < 10_000


@pytest.mark.mcu
def test_a_core_that_is_too_slow_leaves_periods_out(release, sources):
    """At a clock at which a plan takes more than a period, every second period at least is left out."""
    pytest.importorskip("unicorn", reason="unicorn (extra mcu) is not installed")
    log, _ = run(release, loop_ecu(CORTEX_M7, sources, clock_mhz=2.0))
    assert log.metadata.ecu.modelled_ms is not None
    assert log.metadata.ecu.modelled_ms > PERIOD_NS / 1e6
    assert np.isnan(log.series["step_ms"]).any()
    assert log.metadata.status.overruns > 0
    assert dict(service_rows(log))["virtual compute time"].endswith("does not fit")


@each("clock_mhz", [0.0, -480.0, float("nan"), float("inf"), 1e5])
def test_a_clock_that_no_core_has_is_refused(sources, clock_mhz):
    with pytest.raises(ConfigError, match="--clock-mhz"):
        loop_ecu(CORTEX_M7, sources, clock_mhz=clock_mhz)


@pytest.mark.mcu
@pytest.mark.slow  # whole runs with their reports
def test_the_command_runs_each_and_says_so(cli, release, tmp_path):
    outcomes = {}
    for kind in ("c", "cortex-m7"):
        used = ("--bundle", release.bundle_path, "--library", release.folder, "--ecu", kind)
        spans = ("--lead-in", 0.2, "--controlled", 2, "--no-averages", "--set", "ecu.sensor_check.enabled=false")
        json_file = tmp_path / f"{kind}.json"
        done = cli("run", tmp_path / kind, *used, *spans, "--clock-mhz", 240, "--json", json_file)
        assert done.err == ""
        outcomes[kind] = json.loads(json_file.read_text())
        page = (tmp_path / kind / "report.html").read_text()
        assert ("Cortex-M7 at 240 MHz" in page) == (kind == "cortex-m7")
    by_c, by_core = (outcomes[kind]["figures"] for kind in ("c", "cortex-m7"))
    assert by_c["periods_in_control"] == by_core["periods_in_control"] > 0
    assert by_c["ecu"] == {"kind": "c", "clock_mhz": None, "modelled_ms": None, "modelled_ms_max": None}
    assert 0.0 < by_core["ecu"]["modelled_ms"] <= by_core["ecu"]["modelled_ms_max"] < PERIOD_NS / 1e6


def test_a_bundle_that_is_not_the_shipped_one_needs_its_library(cli, release, tmp_path):
    done = cli("run", tmp_path / "run", "--bundle", release.bundle_path, "--ecu", "c")
    assert done.code == 1
    assert "name the bundle's C library with --library" in done.err
    assert not (tmp_path / "run").exists()


@pytest.mark.mcu
def test_the_core_drives_the_live_wake_as_the_host_would(release, sources, tmp_path):
    """A few t_c of the flow itself: every frame and every number of the state, after every step."""
    pytest.importorskip("unicorn", reason="unicorn (extra mcu) is not installed")
    core = loop_ecu(CORTEX_M7, sources)
    both = Lockstep(core.ecu, host(sources).ecu)
    simulation = Simulation(release.bundle, CONFIG, spans=SPANS, ecu=replace(core, ecu=both))
    with open_plant("stillwake", tmp_path, CONFIG) as wake:
        log = simulation.run(wake)
    assert (both.differing_frames, both.differing_states, both.told) == (0, 0, [])
    assert both.steps == 25
    assert both.frames == 50
    assert np.count_nonzero(log.series["mode"] == Mode.CONTROL) > 10


def test_lockstep_finds_another_ecu(release, sources):
    """One whose controller plans for other weights: its states and its commands differ, and the fields are named."""
    other = CEcu(sources, compiler=zig_compiler(), flags=ZIG)
    other.calibrate(replace(other.calibration, weights=replace(other.calibration.weights, lift=9.0)))
    both = Lockstep(host(sources).ecu, other)
    run(release, LoopEcu(ecu=both, kind=C, computed_by="a test"))
    assert both.differing_states > 0
    assert both.differing_frames > 0
    assert "memory.plan" in both.told[0]
    same = Lockstep(host(sources).ecu, host(sources).ecu)
    run(release, LoopEcu(ecu=same, kind=C, computed_by="a test"))
    assert (same.differing_frames, same.differing_states) == (0, 0)
