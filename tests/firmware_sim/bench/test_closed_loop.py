"""A release on the real wake, for a few periods: what the run folder holds, and what is refused."""

import json
from dataclasses import asdict, replace
from typing import Any

import can
import numpy as np
import pytest

from can_bridge.wire.messages import Mode
from contract.config.tree import Config
from contract.config.vehicle import BackgroundConfig, BusConfig, VehicleConfig
from contract.errors import BusError, StillwakeError
from contract.release import bundle
from export.program.random_program import random_program
from firmware_sim.bench.closed_loop import run_closed_loop
from firmware_sim.bench.run_faults import parse_node_fault
from firmware_sim.runs import wake_stills
from firmware_sim.runs.run_folder import RunFolder
from firmware_sim.runs.run_page.report import write_report
from wake.pictures.level_picture import LevelPicture
from wake.truck.state import developed_state

# Whole runs of the loop; the one that is shared has its pictures, since it is made before.
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("no_pictures")]

CONFIG = Config(bus=BusConfig(channel="closed-loop"))
SHORT: dict[str, Any] = {"lead_in": 1.0, "controlled": 1.0, "settle": 0.0, "averages": False}
LEAD_IN, CONTROLLED = 50, 52  # periods
FIGURES = (
    *("Cd_uncontrolled", "Cd_controlled", "reduction_percent", "base_Cp_uncontrolled", "base_Cp_controlled"),
    *("abs_Cl_uncontrolled", "abs_Cl_controlled", "mean_Cl_controlled", "mpc_ms_p50", "mpc_ms_p99", "mpc_ms_max"),
)


@pytest.fixture(scope="module")
def release(random_release) -> bundle.Bundle:
    return bundle.load(random_release)


@pytest.fixture(scope="module")
def run(release, tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "new"
    seen = []
    log = run_closed_loop(
        folder,
        release,
        CONFIG,
        lead_in=10.0,
        controlled=10.4,
        settle=0.4,
        progress=lambda row, done, total: seen.append((row, done, total)),
    )
    write_report(RunFolder(folder))
    return folder, log, seen


def test_the_folder_holds_the_run_and_nothing_half_written(run):
    folder, _, _ = run
    assert sorted(path.name for path in folder.iterdir()) == [
        "frames.log",
        "report.html",
        "series.npz",
        "summary.json",
        "vorticity_controlled.png",
        "vorticity_uncontrolled.png",
        "wake.npz",
    ]


def test_the_recorded_wake_is_the_flow_at_the_start_of_each_period(run, shared_wake):
    folder, log, _ = run
    found = wake_stills.load(RunFolder(folder).wake, log)
    assert found.k.tolist() == list(range(LEAD_IN + CONTROLLED))
    # Without control the loop's wake is the solver's own, advanced by hand.
    shared_wake.reset(developed_state())
    for k in range(4):
        error = found.levels(k).astype(int) - LevelPicture(shared_wake).levels()
        # The codec's loss; a period off, the far vortices alone differ by five times as much.
        assert np.sqrt(np.mean(error**2)) < 2.5, k
        shared_wake.advance(0.0)


def test_the_summary_has_every_figure(run):
    folder, log, _ = run
    found = json.loads((folder / "summary.json").read_text())
    for name in FIGURES:
        assert isinstance(found[name], float), name
    assert (found["frames_sent"], found["frames_lost"], found["frames_rejected"]) == (2 * (LEAD_IN + CONTROLLED), 0, 0)
    assert found["sensors"] == list(random_program(1).sensors)
    assert "random" in found["controller"]
    assert "int8" in found["controller"]
    # One cycle each, on the straight lines between the samples, finely divided: the last one under control, and without
    # it the one between the two upward crossings of the lift.
    t, cd, cl = (log.series[name] for name in ("t", "Cd", "Cl"))
    fine = np.linspace(0.0, t[LEAD_IN], 200_001)
    lift = np.interp(fine, t, cl)
    first, last = fine[1:][(lift[:-1] < 0) & (lift[1:] >= 0)]
    assert found["shedding_frequency"] == pytest.approx(1 / (last - first), rel=1e-4)
    for name, begin, end in (("uncontrolled", first, last), ("controlled", t[-1] - (last - first), t[-1])):
        expected = np.interp(np.linspace(begin, end, 100_001), t, cd).mean()
        assert found[f"Cd_{name}"] == pytest.approx(expected, abs=1e-5)
    assert found["reduction_percent"] == pytest.approx(
        100 * (1 - found["Cd_controlled"] / found["Cd_uncontrolled"]), abs=1e-3
    )
    assert (found["cycles_uncontrolled"], found["cycles_controlled"]) == (1, 1)
    assert found["fault"] is None
    assert found["modes"] == {"CONTROL": CONTROLLED}
    assert found["bundle"]["digest"] == log.metadata.digest
    assert found["settings"]["vehicle"] == asdict(VehicleConfig())
    # The developed wake's known ranges.
    assert 0.9 < found["Cd_uncontrolled"] < 1.3
    assert -1.0 < found["base_Cp_uncontrolled"] < -0.2
    assert 0.0 < found["mpc_ms_p50"] <= found["mpc_ms_p99"] <= found["mpc_ms_max"]


def test_control_starts_when_it_is_requested_and_moves_the_jets(run):
    _, log, seen = run
    assert [(done, total) for _, done, total in seen] == [
        (k + 1, LEAD_IN + CONTROLLED) for k in range(LEAD_IN + CONTROLLED)
    ]
    assert log.enabled_at == LEAD_IN
    modes, actions = log.series["mode"], log.series["action"]
    assert set(modes[:LEAD_IN]) == {Mode.OFF}
    assert set(modes[LEAD_IN:]) == {Mode.CONTROL}
    # Planned ahead: the jets follow a command in the period after, and the sample at its end shows it.
    assert not actions[: LEAD_IN + 2].any()
    # A random controller's action may pass through zero, to the wire's resolution.
    assert np.count_nonzero(actions[LEAD_IN + 2 :]) >= CONTROLLED - 3
    np.testing.assert_array_equal(actions[LEAD_IN + 2 :], log.series["command"][LEAD_IN:-2])
    assert np.diff(log.series["t"]) == pytest.approx(0.2)


def test_the_captured_frames_are_a_log_python_can_reads(run):
    folder, _, _ = run
    with can.CanutilsLogReader(folder / "frames.log") as reader:
        messages = list(reader)
    # A pressure frame, a command and a status in every period.
    ids = [message.arbitration_id for message in messages]
    assert ids == [0x120, 0x130, 0x140] * (LEAD_IN + CONTROLLED)
    assert all(message.is_fd for message in messages)
    times = [message.timestamp for message in messages]
    assert times == sorted(times)
    assert times[3] - times[0] == pytest.approx(0.02, abs=2e-6)


def test_the_page_can_be_written_again_from_the_folder_alone(run):
    folder, _, _ = run
    first = (folder / "report.html").read_text()
    (folder / "report.html").unlink()
    assert write_report(RunFolder(folder)) == folder / "report.html"
    assert (folder / "report.html").read_text() == first


def test_a_folder_without_a_run_is_refused(tmp_path, run):
    with pytest.raises(StillwakeError, match=r"series\.npz"):
        write_report(RunFolder(tmp_path))
    (tmp_path / "series.npz").write_bytes((run[0] / "series.npz").read_bytes())
    with pytest.raises(StillwakeError, match=r"vorticity_uncontrolled\.png: No such file"):
        write_report(RunFolder(tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["series.npz"]


class Stopped(BaseException):
    """Stands for a signal."""


@pytest.mark.parametrize("existing", [True, False])
def test_a_stopped_run_leaves_nothing_behind_and_an_old_one_alone(release, tmp_path, existing):
    folder = tmp_path / "run"
    if existing:
        folder.mkdir()
        (folder / "series.npz").write_text("old")

    def stop(row, done, total) -> None:
        if done == 2:
            assert any(folder.iterdir())
            raise Stopped

    with pytest.raises(Stopped):
        run_closed_loop(folder, release, CONFIG, lead_in=0.2, controlled=1.0, settle=0.0, averages=False, progress=stop)
    assert [path.name for path in tmp_path.rglob("*")] == (["run", "series.npz"] if existing else [])
    if existing:
        assert (folder / "series.npz").read_text() == "old"


def short_run(release, folder, *, lead_in: float = 1.0, faults: tuple[str, ...] = (), fault_seed: int = 0, **bus):
    log = run_closed_loop(
        folder,
        release,
        Config(bus=BusConfig(channel="closed-loop", **bus)),
        lead_in=lead_in,
        controlled=1.0,
        settle=0.0,
        averages=False,
        faults=[parse_node_fault(text) for text in faults],
        fault_seed=fault_seed,
    )
    return log, (folder / "frames.log").read_bytes(), json.loads((folder / "summary.json").read_text())


def test_the_same_run_has_the_same_frames_to_the_byte_also_with_other_traffic(release, tmp_path):
    busy = BackgroundConfig(load=0.5, seed=1)
    first, frames, found = short_run(release, tmp_path / "a", background=busy)
    again, same, _ = short_run(release, tmp_path / "b", background=busy)
    assert frames == same
    for name, values in first.series.items():
        if name != "step_ms":
            np.testing.assert_array_equal(values, again.series[name])
    with can.CanutilsLogReader(tmp_path / "a" / "frames.log") as reader:
        messages = list(reader)
    times = [message.timestamp for message in messages]
    assert times == sorted(times)
    ours = [message.arbitration_id for message in messages if message.arbitration_id in (0x120, 0x130, 0x140)]
    # Ten periods; a frame may be under way at the end.
    assert sorted(set(ours)) == [0x120, 0x130, 0x140]
    assert 28 <= len(ours) <= 30 < len(messages)
    assert found["bus"]["frames"] == len(messages)
    assert 0.3 < found["bus"]["load"] < 0.55
    assert set(found["bus"]["nodes"]) == {"vehicle", "ECU", "background"}
    assert {node["state"] for node in found["bus"]["nodes"].values()} == {"ERROR_ACTIVE"}
    waits = found["bus"]["longest_wait_ms"]
    assert set(waits) == {"Pressure", "JetCommand", "EcuStatus"}
    assert max(waits.values()) > 0.1
    quiet, _, _ = short_run(release, tmp_path / "c")
    # Alone on the bus only the status waits, for the command.
    assert quiet.traffic.longest_wait_ms["Pressure"] == quiet.traffic.longest_wait_ms["JetCommand"] == 0.0
    assert 0.01 < quiet.traffic.load < 0.04
    assert np.nanmax(first.series["age_ms"]) > np.nanmax(quiet.series["age_ms"]) + 0.1


def test_classic_can_closes_the_loop(release, tmp_path):
    log, frames, _ = short_run(release, tmp_path / "run", frames="classic", lead_in=8.0)  # the window fills
    assert b"##" not in frames  # candump's mark of CAN FD
    with can.CanutilsLogReader(tmp_path / "run" / "frames.log") as reader:
        assert [message.arbitration_id for message in reader] == [0x121, 0x131, 0x141] * 45
    assert set(log.series["mode"][log.enabled_at :]) == {Mode.CONTROL}
    assert np.count_nonzero(log.series["action"]) > 0
    assert (log.bus.lost, log.bus.rejected) == (0, 0)


@pytest.mark.parametrize("slow", [BusConfig(nominal_bitrate=100, data_bitrate=100), BusConfig(nominal_bitrate=100)])
def test_a_bus_that_is_too_slow_is_refused(release, tmp_path, slow):
    with pytest.raises(BusError, match=r"a pressure frame takes .* raise bus\.nominal_bitrate or bus\.data_bitrate"):
        run_closed_loop(tmp_path / "run", release, replace(CONFIG, bus=slow), **SHORT)
