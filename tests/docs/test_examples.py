"""The Python of pages and examples runs as it stands, and does what it promises to those who extend stillwake."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
import torch

from can_bridge.bus.faults.fault import wrap
from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.secoc.key import write_key
from can_bridge.wire.frame import Frame
from contract.config.controller import CostWeights
from contract.config.loading import load_config
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.recording.dataset import Dataset, write
from contract.recording.importing.forces import read_forces
from contract.release import bundle
from contract.sensors import TRUCK
from contract.shipped import BUNDLE
from examples import own_selection
from examples.own_faults import EveryNth, WithSensors, clipped, third_lost
from examples.own_plant import OscillatorPlant
from firmware_sim.bench.simulation import Simulation, Spans
from tests.contract.recording.random_episodes import episode
from tests.docs.blocks.pages import ROOT, python
from train.networks.samples import Rows


def test_the_loop_around_the_onnx_graph_commands_within_the_limit():
    """Zero until the window of 32 is full; then actions that differ and keep the shipped bundle's limit of 0.075."""
    code = python("how-to/use-the-onnx-graph.md")[0]
    assert '"runs/bundle"' in code
    commanded: list[float] = []

    def pressures(sensors: list[str]) -> list[float]:
        phase = 2 * np.pi * len(commanded) / 25 + np.arange(len(sensors))
        return (-0.4 + 0.1 * np.sin(phase)).tolist()

    names = {"read_pressures": pressures, "command": commanded.append}
    exec(compile(code.replace('"runs/bundle"', repr(str(BUNDLE))), "page", "exec"), names)
    assert commanded[:31] == [0.0] * 31
    assert np.std(commanded[31:]) > 0.01
    assert np.abs(commanded).max() <= 0.075 * (1 + 1e-6)
    # The page takes the order of the input `weights` from this table.
    order = ", ".join(f"`{item.name}`" for item in fields(CostWeights))
    assert f"| {order} |" in (ROOT / "docs/how-to/calibrate.md").read_text(encoding="utf-8")


def test_the_conversion_of_a_rig_s_numbers_gives_coefficients(tmp_path, monkeypatch):
    """The same signals in seconds, pascals and newtons, at W = 0.1 m, 20 m/s, 1.2 kg/m3 and a span of 0.4 m."""
    (code,) = python("how-to/use-your-own-data.md")
    monkeypatch.chdir(tmp_path)
    step = np.arange(400)
    names = [f"p{k}" for k in range(1, 9)]
    # 3 kHz; forces over (240 Pa) (0.1 m) (0.4 m) = 9.6 N, a volume flow over 20 m/s 0.1 m 0.4 m = 0.8 m3/s.
    constant = {"flow_m3s": 0.04, "drag_N": 9.6, "side_N": -4.8, **dict.fromkeys(names, -120.0)}
    series = {"time_s": step / 3000, **{name: np.full(400, value) for name, value in constant.items()}}
    table = np.column_stack(list(series.values()))
    np.savetxt("rig.csv", table, delimiter=",", header=",".join(series), comments="")
    exec(compile(code, "page", "exec"), {})
    made = np.genfromtxt("sweep.csv", delimiter=",", names=True)
    assert made.dtype.names == ("t", "action", "Cd", "Cl", *names)
    # 5 ms is the time W / U_inf, so 1 ms, three samples, is a period of 0.2.
    np.testing.assert_allclose(np.diff(made["t"]), 0.2, rtol=1e-6)
    np.testing.assert_allclose([made[name][7] for name in ("action", "Cd", "Cl", "p3")], [0.05, 1.0, -0.5, -0.5])


def test_forces_on_the_bus_become_a_table_on_the_log_s_clock(tmp_path, monkeypatch):
    (code,) = python("how-to/train-from-a-can-log.md")
    monkeypatch.chdir(tmp_path)
    signals = '\n SG_ Drag : 0|16@1- (0.001,0) [0|0] "" X\n SG_ Side : 16|16@1- (0.001,0) [0|0] "" X\n'
    Path("balance.dbc").write_text(f'VERSION ""\nBU_: X\nBO_ 416 Balance: 4 X{signals}', encoding="utf-8")
    with can.Logger("monday.blf") as log:
        for k in range(3):
            data = (1000 + k).to_bytes(2, "little") + (65536 - 500).to_bytes(2, "little")
            balance = {"arbitration_id": 0x1A0, "is_extended_id": False, "data": data}
            for message in (balance, {"arbitration_id": 0x120, "is_fd": True}):
                log.on_message_received(can.Message(timestamp=1.7e9 + k, **message))
    exec(compile(code, "page", "exec"), {})
    table = read_forces(tmp_path / "monday.csv", {})
    for name, values in (("Cd", [1.0, 1.001, 1.002]), ("Cl", [-0.5] * 3)):
        np.testing.assert_allclose(table.t, [1.7e9, 1.7e9 + 1, 1.7e9 + 2])
        np.testing.assert_allclose(table.values[name], values)


def test_a_node_in_real_time_counts_its_power_cycles(tmp_path, monkeypatch):
    """Run twice: the frames of the second power cycle are fresher than any of the first."""
    (code,) = python("explanation/protection.md")
    monkeypatch.chdir(tmp_path)
    write_key(Path("bus.key"), bytes(range(1, 17)))
    release, config = bundle.load(BUNDLE), Config(bus=BusConfig(key="bus.key"))
    values = []
    for _ in range(2):
        names: dict[str, Any] = {"bundle": release, "controller": None, "config": config}
        exec(compile(code, "page", "exec"), names)
        (command, _) = names["ecu"].step(0, [])
        values.append(int.from_bytes(command.data[-16:-8], "big"))
    assert values == [1 << 32, 2 << 32]


def test_a_selection_finds_the_sensors_that_the_forces_are_made_of():
    """Drag is sensor 70, side force sensors 12 and 33; the others are noise, and one is a copy of 12."""
    draws = np.random.default_rng(1).standard_normal((500, 91)).astype(np.float32)
    draws[:, 40] = draws[:, 12]
    forces = np.column_stack([3.0 * draws[:, 70], 2.0 * draws[:, 12] + draws[:, 33]])
    inputs, actions, unit = torch.from_numpy(draws), torch.from_numpy(draws[:, 90]), torch.ones(90)
    rows = Rows(inputs=inputs, actions=actions, forces=torch.from_numpy(forces), lengths=(500,), unit=unit)
    first, second, third = own_selection.select_by_forces(rows, 3)
    assert first == 70
    assert second in (12, 40)
    assert third == 33


def test_its_script_prints_names_that_train_takes(tmp_path, capsys):
    write(tmp_path / "my.h5", Dataset(episodes=(episode(steps=60),)))
    own_selection.main(str(tmp_path / "my.h5"), 4)
    assert len(TRUCK.indices(capsys.readouterr().out.strip().split(","))) == 4
    with pytest.raises(SystemExit, match=r"none\.h5: no such dataset"):
        own_selection.main(str(tmp_path / "none.h5"), 4)


def test_the_oscillator_sheds_at_its_own_frequency_without_jets():
    """Limit cycle: abs(z) = 1 within the error of the Euler step, 25 control periods to a cycle."""
    config = load_config()
    oscillator = OscillatorPlant(config.flow)
    samples = []
    for _ in range(100):
        oscillator.advance_to(config.flow.substeps)
        samples.append(oscillator.sample())
    assert samples[-1].Cd == pytest.approx(0.65 + 0.38, rel=0.03)
    lift = np.array([sample.Cl for sample in samples])
    rises = np.flatnonzero((lift[:-1] < 0) & (lift[1:] >= 0))
    np.testing.assert_allclose(np.diff(rises), 25, atol=1)


def test_the_shipped_controller_drives_it_over_the_bus(capsys):
    names: dict[str, Any] = {}
    exec(compile(python("how-to/add-a-plant.md")[0], "page", "exec"), names)
    log = names["log"]
    assert log.bus.lost == log.bus.rejected == 0
    assert set(log.series["mode"][70:]) == {log.series["mode"][-1]}
    assert np.abs(log.series["command"][70:]).max() > 0.01
    assert "sent=" in capsys.readouterr().out


def test_every_third_frame_is_lost_at_a_port_and_in_a_run_with_clipped_sensors():
    bus = SimulatedBus(BusConfig())
    port = wrap(bus.port("vehicle"), [EveryNth(n=3)], clock=lambda: bus.now_ns, seed=1)
    for number in range(7):
        port.send(Frame(frame_id=number, data=b""))
    assert [injector.acted for injector in port.injectors] == [2]
    config = load_config()
    faulty = WithSensors(OscillatorPlant(config.flow), clipped(0.25))
    wide = Spans(lead_in=8.0, controlled=28.0, settle=0.0, averages=False)
    log = Simulation(bundle.load(BUNDLE), config, spans=wide, disturbances=third_lost(3.0)).run(faulty)
    (injected,) = log.metadata.faults
    # From 3 s to 3.6 s there are 60 frames of the vehicle: pressures and speeds.
    assert (injected.text, injected.acted) == ("vehicle:every_nth:n=3", 20)
    assert np.abs(log.series["wall_Cp"]).max() == pytest.approx(0.25)
