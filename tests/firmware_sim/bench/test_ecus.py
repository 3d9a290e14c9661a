"""A run with each ECU: the same commands from all, and virtual time by the core's cycles."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.ecu.ecu_loop import Lockstep
from contract.errors import ConfigError
from ecu.in_c.c_ecu import CEcu
from ecu.in_c.compiler import zig_compiler
from ecu.stepped import LoopEcu
from firmware_sim.bench.ecus import MCU, C, check_ecu, loop_ecu
from firmware_sim.bench.simulation import Simulation, Spans
from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.summary import service_rows
from tests.ecu.in_c.exported import CONFIG, Exported
from tests.firmware_sim.bench.harness import LiveOscillator

pytestmark = [pytest.mark.compiler, pytest.mark.usefixtures("no_pictures")]
SPANS = Spans(lead_in=1.0, controlled=4.0, settle=0.0, averages=False)
ZIG = (*("-O3", "-ffp-contract=on", "-g0"), "-march=native")


def run(release: Exported, ecu: LoopEcu) -> RunLog:
    return Simulation(release.bundle, CONFIG, spans=SPANS, ecu=ecu).run(LiveOscillator(CONFIG))


def host(sources) -> LoopEcu:
    return LoopEcu(ecu=CEcu(sources, compiler=zig_compiler(), flags=ZIG), kind=C, computed_by="a test")


@pytest.mark.proofs
@pytest.mark.mcu
def test_the_core_sends_and_keeps_what_the_host_does_in_its_own_time(release, sources):
    """Every frame and every number of the state, after every step; a step is charged as the core's cycles."""
    core = loop_ecu(MCU, sources, clock_mhz=480.0)
    both: Any = Lockstep(core.ecu, host(sources).ecu)
    log, slower = run(release, replace(core, ecu=both)), run(release, host(sources))
    assert (both.differing_frames, both.differing_states, both.differences) == (0, 0, [])
    assert (both.steps, both.frames) == (25, 50)
    ecu, gained = log.metadata.ecu, slower.series["age_ms"] - log.series["age_ms"]
    assert ecu.modelled_ms is not None and 0.0 < ecu.modelled_ms < CONFIG.ecu.compute_time_ms
    assert np.nanmedian(gained[5:]) == pytest.approx(CONFIG.ecu.compute_time_ms - ecu.modelled_ms, abs=0.1)


@pytest.mark.mcu
def test_a_core_whose_clock_starts_again_runs_as_at_first(release, sources):
    """A core whose clock is ahead of a run leaves out all periods until the run has reached that time."""
    core = loop_ecu(MCU, sources)
    powered_on, commands = core.ecu.state, []
    for _ in range(2):
        commands.append(run(release, core).series["command"])
        core.start_clock()
        core.ecu.restore(powered_on)
    np.testing.assert_array_equal(commands[0], commands[1])


@pytest.mark.mcu
def test_a_core_that_is_too_slow_leaves_periods_out(release, sources):
    ecu, spans = loop_ecu(MCU, sources, clock_mhz=2.0), replace(SPANS, controlled=1.6)
    log = Simulation(release.bundle, CONFIG, spans=spans, ecu=ecu).run(LiveOscillator(CONFIG))
    core, rows = log.metadata.ecu, dict(service_rows(log))
    assert core.modelled_ms is not None and core.modelled_ms > CONFIG.period_ns / 1e6
    assert rows["ECU"] == "in C, on an emulated Cortex-M7 at 2 MHz"
    assert f"{core.modelled_ms:.2f} / {core.modelled_ms_max:.2f} ms" in rows["virtual compute time"]
    assert np.isnan(log.series["step_ms"]).any()
    assert log.metadata.status.overruns > 0
    assert rows["virtual compute time"].endswith("does not fit")


@pytest.mark.mcu
@pytest.mark.slow  # a whole run with its report
def test_the_command_runs_the_core_and_needs_the_library_of_a_bundle_of_ones_own(cli, release, coarse, tmp_path):
    spans = ("--lead-in", 0.2, "--controlled", 2, "--no-averages", "--set", "ecu.sensor_check.enabled=false")
    used = ("--bundle", release.bundle_path, "--ecu", f"{MCU}@240", *spans, *coarse.words)
    done = cli("run", tmp_path / "run", *used, "--library", release.folder, "--json", tmp_path / "run.json")
    assert done.err == ""
    figures = json.loads((tmp_path / "run.json").read_text())["figures"]
    assert figures["periods_in_control"] > 0
    assert 0.0 < figures["ecu"]["modelled_ms"] <= figures["ecu"]["modelled_ms_max"] < CONFIG.period_ns / 1e6
    assert "Cortex-M7 at 240 MHz" in (tmp_path / "run" / "report.html").read_text()
    done = cli("run", tmp_path / "none", *used)
    assert (done.code, (tmp_path / "none").exists()) == (1, False)
    assert "name the bundle's C library with --library" in done.err
    for clock_mhz in (0.0, -480.0, float("nan"), float("inf"), 1e5):
        with pytest.raises(ConfigError, match="a clock of"):
            check_ecu(MCU, clock_mhz)


def test_lockstep_finds_another_ecu(release, sources):
    """One whose controller plans for other weights: its states and its commands differ, and the fields are named."""
    own, other = CEcu(sources), CEcu(sources)
    other.calibrate(replace(other.calibration, weights=replace(other.calibration.weights, lift=9.0)))
    check_ecu(C, 0.0)  # its clock is the host's
    both = Lockstep(own, other)
    run(release, LoopEcu(ecu=both, kind=C, computed_by="a test"))
    assert both.differing_states > 0
    assert both.differing_frames > 0
    assert "memory.plan" in both.differences[0]
