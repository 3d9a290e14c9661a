"""`identify`, `export` and `run` on a linear controller: from a data set to the loop over the bus."""

import json
from dataclasses import replace

import numpy as np
import pytest

from contract.config.loading import load_config
from contract.model import linear_model_folder
from contract.recording import dataset
from contract.recording.dataset import Dataset, Episode
from contract.recording.facts import PlantFacts
from contract.release import bundle
from contract.runtime.onnx_session import OnnxController
from contract.sensors import TRUCK
from export.program.linear_program import LinearProgram
from export.reference.linear import linear_control_step
from firmware_sim.in_c.library_controller import open_library
from firmware_sim.runs import run_log
from tests.train.linear.systems import episode
from train.linear.differences import SENSORS
from train.linear.pipeline import Design, Identification, identify_all

FACTS = PlantFacts(control_period=0.2, action_limit=0.075, reynolds=500.0)
OPTIONS = ("--window", "6", "--leave-out", "10")
SPANS = ("--lead-in", "2", "--controlled", "2", "--no-averages")


def on_the_truck(name: str, seed: int) -> Episode:
    """The same differences at the truck's places, all other sensors as in still air."""
    known = episode(name, 400, seed, noise=0.005, probe=True)
    Cp = np.zeros((len(known), len(TRUCK)))
    Cp[:, TRUCK.indices(SENSORS)] = known.series["Cp"]
    Cp += 1e-3 * np.random.default_rng(seed).normal(size=Cp.shape)
    return replace(known, series={**known.series, "Cp": Cp})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Recordings of a linear system on the truck's sensors, and a model of it whose loop needs few periods."""
    place = tmp_path_factory.mktemp("linear")
    episodes = tuple(on_the_truck(f"controlled_{seed}", seed) for seed in range(2))
    dataset.write(place / "short.h5", Dataset(episodes=episodes, facts=FACTS))
    dataset.write(place / "one.h5", Dataset(episodes=episodes[:1], facts=FACTS))
    how = Identification(window=6, leave_out=10)
    identify_all(place / "short.h5", place / "model", load_config(), how, Design())
    return place


def test_a_model_is_identified_and_described(cli, folder, tmp_path):
    done = cli("identify", tmp_path / "m", *OPTIONS, "--dataset", folder / "short.h5", "--json", tmp_path / "m.json")
    assert done.code == 0, done.err
    assert "spectral radius, closed loop" in done.out
    figures = json.loads((tmp_path / "m.json").read_text())
    assert figures["figures"]["closed_loop"] < 1.0
    assert figures["facts"]["identification"]["window"] == 6
    again = cli("identify", tmp_path / "m", *OPTIONS)
    assert again.code == 1
    assert "--overwrite" in again.err


def test_what_a_linear_model_cannot_do_is_one_line(refused, folder, tmp_path):
    export = ("export", folder / "model", tmp_path / "b")
    identify = ("identify", tmp_path / "m", "--dataset", folder / "short.h5")
    for words, named in (
        ((*identify, "--sensors", "upper_39,base_0"), "upper_39 and base_0 are no pair"),
        ((*identify, "--ridge", "-1"), "ridge = -1"),
        ((*identify, "--dataset", "nowhere.h5"), "nowhere.h5"),
        ((*export, "--precision", "int8"), "--precision int8: a linear controller is float32 only"),
        (export, "fitted to"),
    ):
        assert named in refused(*words), words


def test_another_recording_must_be_named(cli, folder, tmp_path):
    done = cli("export", folder / "model", tmp_path / "b", "--dataset", folder / "one.h5")
    assert done.code == 0, done.err
    assert "is not the recording that the model was fitted to" in done.out


@pytest.mark.compiler
@pytest.mark.slow  # a run of the loop, and builds
@pytest.mark.usefixtures("no_pictures")
def test_bundle_and_library_drive_the_loop(cli, folder, tmp_path, coarse):
    """The bundle round trip, graph and library next to the reference, and the ECU in C over the bus."""
    used = ("--dataset", folder / "short.h5", "--set", "mpc.horizon=9")
    done = cli("export", folder / "model", tmp_path / "b", "--c", tmp_path / "c", *used)
    assert done.code == 0, done.err
    release = bundle.load(tmp_path / "b")
    manifest = release.manifest
    assert manifest.is_linear
    assert (manifest.precision, manifest.window, manifest.mpc.horizon, manifest.mpc.iterations) == ("float32", 6, 9, 1)
    assert manifest.sensors == SENSORS
    assert manifest.sensor_positions == tuple((x, y) for x, y in TRUCK.positions[TRUCK.indices(SENSORS)].tolist())
    described = cli("bundle", "inspect", tmp_path / "b")
    assert "linear controller" in described.out

    program = LinearProgram.of(linear_model_folder.read(folder / "model"), manifest.mpc)
    window = np.column_stack([0.1 * np.random.default_rng(0).normal(size=(6, 4)) - 0.4, np.full(6, 0.01)])
    expected = linear_control_step(program, window, np.zeros(9), np.ones(9))
    for controller in (OnnxController.of(release), open_library(tmp_path / "c", release)):
        found = controller.control_step(window, np.zeros(9), np.ones(9))
        np.testing.assert_allclose(found.plan, expected.plan, atol=1e-6)
        np.testing.assert_allclose(found.forces, expected.forces, atol=1e-5)

    in_c = ("--ecu", "c", "--library", tmp_path / "c")
    ran = cli("run", tmp_path / "run", "--bundle", tmp_path / "b", *in_c, *SPANS, *coarse.words)
    assert ran.code == 0, ran.err
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["modes"] == {"CONTROL": 10}
    assert np.abs(run_log.load(tmp_path / "run" / "series.npz").series["action"]).max() > 0.0
