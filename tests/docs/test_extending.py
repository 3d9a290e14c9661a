"""The code of pages and examples for methods, plants and faults of one's own does what they promise, as it stands."""

from typing import Any

import numpy as np
import pytest
import torch

from can_bridge.bus.faults.fault import wrap
from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.wire.frame import Frame
from contract.config.loading import load_config
from contract.config.vehicle import BusConfig
from contract.recording.dataset import UNITS, Dataset, Episode, write
from contract.release.bundle import load
from contract.sensors import TRUCK
from contract.shipped import BUNDLE
from examples import own_selection
from examples.own_faults import EveryNth, WithSensors, clipped, third_lost
from examples.own_plant import OscillatorPlant
from firmware_sim.bench.simulation import Simulation, Spans
from tests.docs.blocks.pages import python
from train.networks.samples import Rows


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
    rng = np.random.default_rng(2)
    series = {name: rng.normal(size=(60, len(TRUCK)) if name == "Cp" else 60) for name in UNITS}
    series["t"], series["action"] = 0.2 * np.arange(60.0), 0.01 * np.sin(np.arange(60.0))
    episode = Episode(name="one", role="train", series=series, initial_action=0.0, provenance={})
    write(tmp_path / "my.h5", Dataset(episodes=(episode,)))
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
    log = Simulation(load(BUNDLE), config, spans=wide, disturbances=third_lost(3.0)).run(faulty)
    (injected,) = log.metadata.faults
    # From 3 s to 3.6 s there are 60 frames of the vehicle: pressures and speeds.
    assert (injected.text, injected.acted) == ("vehicle:every_nth:n=3", 20)
    assert np.abs(log.series["wall_Cp"]).max() == pytest.approx(0.25)
