"""The plant's FMU, imported by another library, and the loop that both FMUs close."""

import copy
import json
import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fmpy.validation import validate_fmu

from contract.config.loading import to_tree
from contract.config.tree import Config
from firmware_sim.bench.ecus import C, loop_ecu
from firmware_sim.bench.simulation import Simulation, Spans
from firmware_sim.fmu.fmu_files import plant_fmu
from firmware_sim.fmu.kinds import FmuKind
from tests.ecu.in_c.exported import CONFIG
from tests.firmware_sim.fmu.imported import Imported, Imported2, check_order_of_calls
from wake.plant.drive import Drive
from wake.plants import own_wake

pytest.importorskip("pythonfmu3", reason="pythonfmu3 (extra fmu) is not installed")

pytestmark = [pytest.mark.slow, pytest.mark.compiler]  # the flow, twice
PERIOD_S, LEAD_IN, PERIODS = CONFIG.period_ns / 1e9, 6, 16


@pytest.fixture(scope="module")
def config(coarse) -> Config:
    return replace(CONFIG, flow=coarse.flow)


@pytest.fixture(scope="module")
def start(coarse) -> Path:
    return Path(coarse.words[1])


@pytest.fixture(scope="module")
def plant_path(config, start, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("plant") / "plant.fmu"
    path.write_bytes(plant_fmu(config, start))
    return path


def test_both_fmus_together_are_the_own_loop_to_the_bit(plant_path, config, start, release, fmu_of):
    """Inputs are set from outputs, then both step: a command for the next period acts in it."""
    path, sources = fmu_of(config)
    assert validate_fmu(str(plant_path)) == []
    ecu, plant = Imported(path), Imported(plant_path)
    pressures = [name for name in ecu.variables if name.startswith("pressure.")]
    found = []
    for k in range(PERIODS):
        found.append([plant["Cd"], plant["Cl"], plant["convective_time"]])
        plant["jet_flow"] = ecu["flow_command"]
        for name in pressures:
            ecu[name] = plant[name]
        ecu["enable_request"] = k >= LEAD_IN
        for imported in (ecu, plant):
            imported.step(PERIOD_S)
    assert ecu["next_period"]
    assert ecu["flow_command"] != 0.0
    t = config.flow.control_period
    spans = Spans(lead_in=LEAD_IN * t, controlled=(PERIODS - LEAD_IN) * t, settle=t, averages=False)
    own_loop = Simulation(release.bundle, config, spans=spans, ecu=loop_ecu(C, sources))
    log = own_loop.run(own_wake(config, start=start))
    assert np.abs(log.series["action"]).max() > 0.01
    own = np.stack([log.series[name] for name in ("Cd", "Cl", "t")], axis=1)
    np.testing.assert_array_equal(np.array(found), own)


def test_its_stream_follows_the_vehicle_and_a_state_is_gone_back_to(plant_path, config, start):
    """As on the same drive in the own loop; a step of any length has the control periods that end in it."""
    speeds = (25.0, 24.0, 23.0, 23.0)
    plant, wake = Imported(plant_path), own_wake(config, start=start)
    drive = Drive(name="braking", times=tuple(k * PERIOD_S for k in range(len(speeds))), speeds=speeds)
    wake.wind = drive.wind(CONFIG.operating_point, wake.t)
    found = []
    for k, speed in enumerate(speeds[1:]):
        if k == 1:
            state, at = plant.fmu.getFMUState(), plant.time
        plant["vehicle_speed"] = speed
        plant.step(PERIOD_S)
        found.append(plant["Cd"])
        assert plant["Cd"] == pytest.approx(wake.advance(0.0).Cd, rel=1e-9)  # lines that are the same on paper
    plant.fmu.setFMUState(state)
    plant.time = at
    for k in (1, 2):
        plant["vehicle_speed"] = speeds[k + 1]
        plant.step(PERIOD_S)
        assert plant["Cd"] == found[k]
    parts, pair = Imported(plant_path, start=5.0), Imported(plant_path)
    for k, speed in enumerate(speeds[1:3]):
        parts["vehicle_speed"] = speed
        parts.step(PERIOD_S / 4)
        assert parts["Cd"] == (found[k - 1] if k else Imported(plant_path)["Cd"])
        parts["vehicle_speed"] = 30.0  # amid the period: of the next one
        parts.step(3 * PERIOD_S / 4)
        assert parts["Cd"] == found[k]
    pair["vehicle_speed"] = speeds[1]
    pair.step(2 * PERIOD_S)
    wake = own_wake(config, start=start)
    wake.wind = Drive(name="once", times=(0.0, PERIOD_S), speeds=speeds[:2]).wind(CONFIG.operating_point, wake.t)
    assert pair["Cd"] == pytest.approx([wake.advance(0.0).Cd for _ in range(2)][1], rel=1e-9)


def test_by_fmi_2_it_is_the_same_plant(plant_path, config, start, tmp_path):
    path = tmp_path / "plant2.fmu"
    path.write_bytes(plant_fmu(config, start, FmuKind(fmi2=True)))
    assert validate_fmu(str(path)) == []
    plants = Imported(plant_path), Imported2(path)
    for plant in plants:
        plant["vehicle_speed"] = 24.0
        plant.step(PERIOD_S)
    assert plants[0].values == plants[1].values


def test_calls_out_of_order_are_refused_and_fmpys_own_step_is_served(plant_path, capsys):
    check_order_of_calls(plant_path, "jet_flow", "Cd", capsys)


def test_the_command_writes_it_and_refuses_a_plant_that_cannot_begin(cli, coarse, tmp_path):
    path = tmp_path / "plant.fmu"
    assert "the shipped start has 500" in cli("plant-fmu", path, "--set", "flow.reynolds=700").err
    assert not path.exists()
    assert cli("plant-fmu", path, *coarse.words).code == 0 and path.exists()


def test_a_copy_of_what_runs_in_it_reads_its_own_outputs(config, start, tmp_path):
    from firmware_sim.fmu.plant_slave import SETTINGS, START, StillwakePlant

    (tmp_path / SETTINGS).write_text(json.dumps(to_tree(config)), encoding="utf-8")
    shutil.copy(start, tmp_path / START)
    slave = StillwakePlant(instance_name="wake", resources=str(tmp_path))
    slave.vehicle_speed = 24.0
    slave.do_step(0.0, PERIOD_S)

    def drag(one: StillwakePlant) -> float:
        (variable,) = (variable for variable in one.vars.values() if variable.name == "Cd")
        return float(variable.getter())

    before = drag(slave)
    copies = [copy.copy(slave), copy.deepcopy(slave), pickle.loads(pickle.dumps(slave))]
    for one in (*copies, slave):
        assert drag(one) == before
        one.vehicle_speed = 23.0
        one.do_step(PERIOD_S, PERIOD_S)
    assert len({drag(one) for one in (*copies, slave)}) == 1
    assert drag(slave) != before
