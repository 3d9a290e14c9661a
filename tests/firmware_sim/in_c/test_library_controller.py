"""The loop with the C library: the commands of ONNX Runtime, and no library but the bundle's.

Tolerances are those of the export gates (`export.gates.parity`, `export.gates.quantisation`). On the bus the wire's
resolution comes on top: two actions on either side of a rounding boundary part by one step of it.
"""

import html
import json
import shutil
from dataclasses import dataclass, fields, replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stillwake.__main__
from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import Mode
from contract import sensors
from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from contract.controller.interface import Controller, ControllerError
from contract.errors import LibraryError
from contract.model.model_folder import Provenance
from contract.release import bundle
from contract.release.manifest import Precision
from contract.runtime.onnx_session import OnnxController
from export.gates.quantisation import QuantisationLimits
from export.int8.calibrate import rounded_on
from export.program.random_program import random_program
from export.release.bundle import Vehicle, write_release
from export.release.c_folder import write_c_release
from export.release.gated import gate
from export.release.lowering import lower
from firmware_sim.bench.vehicle_node import VehicleNode
from firmware_sim.bench.virtual_loop import BusPorts, VirtualLoop
from firmware_sim.ecu.ecu import Ecu
from firmware_sim.in_c.compiler import OPTIMISED, compiler_version, host_compiler
from firmware_sim.in_c.host_library import CController
from firmware_sim.in_c.library_controller import open_library
from wake.plant.sample import Sample

try:
    host_compiler()
except LibraryError as error:
    pytest.skip(str(error), allow_module_level=True)

CONFIG = Config(ecu=EcuConfig(plan_ahead=False))
LENIENT = QuantisationLimits(rms_action_error=0.05, max_cost_gap=1.0)
MPC = MpcConfig(horizon=8)
PROGRAM = random_program(1, model=ModelConfig(latent=3, lstm_width=8, dynamics_width=16, decoder_width=8), mpc=MPC)
REACH = MPC.iterations * MPC.learning_rate
"""The way that Adam can take an action in one step."""
RESOLUTION = FLOW_RESOLUTION_M2_PER_S / CONFIG.operating_point.flow_rate_scale
FAST_BUILD = ("-O1",)


@dataclass(frozen=True)
class Exported:
    bundle: bundle.Bundle
    bundle_path: Path
    folder: Path


class Swing:
    """Pressures that swing at the shedding's frequency, and by what the jets do; forces are of no interest."""

    def __init__(self) -> None:
        self.substeps = CONFIG.flow.substeps
        self.done, self.action = 0, 0.0

    def sample(self) -> Sample:
        t = CONFIG.flow.control_period * self.done / self.substeps
        phase = np.linspace(0.0, 3.0, sensors.COUNT)
        Cp = -0.4 + 0.2 * np.sin(2 * np.pi * 0.2 * t + phase) + 2.0 * self.action * np.cos(phase)
        forces: dict[str, Any] = dict.fromkeys((item.name for item in fields(Sample)), 0.0)
        return Sample(**{**forces, "t": t, "Cp": Cp, "action": self.action})

    def advance_to(self, substep: int, action: float | None = None) -> None:
        self.done += substep - self.done % self.substeps
        self.action = self.action if action is None else action


def recorded(count: int) -> list[np.ndarray]:
    """Consecutive windows (L, S+1) of a swing under random actions: int8 is calibrated where it is used."""
    rng, swing, rows, action = np.random.default_rng(0), Swing(), [], 0.0
    for _ in range(PROGRAM.window + count - 1):
        rows.append(np.append(swing.sample().Cp[sensors.TRUCK.indices(PROGRAM.sensors)], action))
        action = float(rng.uniform(-PROGRAM.action_limit, PROGRAM.action_limit))
        swing.advance_to(swing.substeps, action)
    return [np.array(rows[i : i + PROGRAM.window]) for i in range(count)]


def exported(root: Path, precision: Precision) -> Exported:
    """The bundle of `random_release` in either precision, and the C library of the same export."""
    windows = recorded(30)
    program = rounded_on(PROGRAM, windows) if precision == "int8" else PROGRAM
    gated = gate(lower(program, calibration=windows, with_library=True), windows[:4], LENIENT, compiled=CController)
    provenance = Provenance(dataset_sha256="0" * 64, weights_sha256="0" * 64, metrics={}, versions={}, config={})
    write_c_release(root / "c", gated, windows[:4])
    write_release(
        root / "bundle",
        gated,
        name="random",
        created=date(2026, 1, 2),
        vehicle=Vehicle.of(CONFIG),
        provenance=provenance,
    )
    return Exported(bundle.load(root / "bundle"), root / "bundle", root / "c")


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Exported:
    return exported(tmp_path_factory.mktemp("float32"), "float32")


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Exported:
    return exported(tmp_path_factory.mktemp("int8"), "int8")


def commands(
    release: Exported, controller: Controller, weights: CostWeights | None = None, periods: int = 25
) -> np.ndarray:
    """What the ECU sends once its window is full, over the bus and with all its delays, U_inf W."""
    bus, ecu = SimulatedBus(CONFIG.bus), Ecu(release.bundle, controller, CONFIG)
    if weights is not None:
        ecu.calibrate(replace(ecu.calibration, weights=weights))
    loop = VirtualLoop(
        Swing(),
        VehicleNode(release.bundle.manifest.sensors, CONFIG),
        ecu,
        bus,
        BusPorts(vehicle=bus.port(), ecu=bus.port()),
        CONFIG,
    )
    # The request rises once: one that stands at power-on is none.
    rows = [loop.period(enable_request=k > 0) for k in range(PROGRAM.window + periods)]
    controlled = [row.command for row in rows if row.mode == Mode.CONTROL]
    assert len(controlled) >= periods - 2
    return np.array(controlled)


def test_in_float32_the_loop_gets_the_commands_of_onnx(whole):
    onnx, library = OnnxController.of(whole.bundle), open_library(whole.folder, whole.bundle, flags=FAST_BUILD)
    with_onnx, with_c = (commands(whole, controller) for controller in (onnx, library))
    np.testing.assert_allclose(with_c, with_onnx, rtol=0, atol=5e-3 * REACH + RESOLUTION)
    assert np.abs(with_onnx).max() > REACH


def test_other_weights_are_taken_by_both_and_change_the_commands(whole):
    """The bundle and its library are of one program with the weights as an input: both plan alike for others."""
    weights = CostWeights(drag_mean=0.0, lift=5.0, smoothness=0.0)
    onnx, library = OnnxController.of(whole.bundle), open_library(whole.folder, whole.bundle, flags=FAST_BUILD)
    usual, with_onnx, with_c = commands(whole, onnx), *(commands(whole, one, weights) for one in (onnx, library))
    np.testing.assert_allclose(with_c, with_onnx, rtol=0, atol=5e-3 * REACH + RESOLUTION)
    assert np.abs(with_onnx - usual).max() > REACH
    # The bundle's own, given by name, are the bundle's.
    np.testing.assert_array_equal(commands(whole, onnx, whole.bundle.manifest.mpc.weights), usual)


def test_in_int8_the_loop_stays_within_the_int8_gate(small):
    """Both have the same int8 weights; the library also rounds activations. The limit is the gate's for weights."""
    onnx, library = OnnxController.of(small.bundle), open_library(small.folder, small.bundle, flags=FAST_BUILD)
    with_onnx, with_c = (commands(small, controller) for controller in (onnx, library))
    assert 0 < np.sqrt(np.mean(np.square(with_c - with_onnx))) < QuantisationLimits().rms_action_error
    assert np.abs(with_onnx).max() > REACH


@pytest.mark.slow  # a whole run with its report
@pytest.mark.usefixtures("no_pictures")
def test_the_command_runs_it_and_says_so(whole, monkeypatch, capsys, tmp_path):
    arguments = ["run", tmp_path / "run", "--bundle", whole.bundle_path, "--library", whole.folder]
    spans = ["--lead-in", "0.2", "--controlled", "0.2", "--no-averages"]
    monkeypatch.setattr("sys.argv", ["stillwake", *map(str, arguments), *spans])
    with pytest.raises(SystemExit) as stop:
        stillwake.__main__.main()
    # Too short for the window: never in control.
    assert stop.value.code == 3
    version = compiler_version(host_compiler())
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["computed_by"] == f"C99 float32, {version}, {' '.join(OPTIMISED)}"
    assert summary["computed_by"] in html.unescape((tmp_path / "run" / "report.html").read_text())
    assert version in capsys.readouterr().out


def test_the_library_of_another_program_is_refused(whole, small):
    """The int8 library is another program than the float one: its weights are rounded."""
    with pytest.raises(LibraryError) as refusal:
        open_library(small.folder, whole.bundle)
    rounded = small.bundle.manifest.program_sha256
    assert rounded[:12] in str(refusal.value)
    assert whole.bundle.manifest.program_sha256[:12] in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert rounded != whole.bundle.manifest.program_sha256


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("#define SW_HORIZON 8", "#define SW_HORIZON 9", "its sizes are not the program's"),
        ("#define SW_DBC_SHA256", '#define SW_DBC_SHA256 "0" //', "another stillwake.dbc"),
        ("#define SW_PRECISION", "#define SW_PRECISE", "SW_PRECISION is missing"),
    ],
)
def test_an_altered_header_is_refused(whole, tmp_path, old, new, said):
    folder = tmp_path / "c"
    shutil.copytree(whole.folder, folder)
    header = (folder / "sw_settings.h").read_text()
    assert old in header
    (folder / "sw_settings.h").write_text(header.replace(old, new))
    with pytest.raises(LibraryError, match=said):
        open_library(folder, whole.bundle)


def test_sources_that_do_not_compile_are_one_line(whole, tmp_path):
    folder = tmp_path / "c"
    shutil.copytree(whole.folder, folder)
    (folder / "sw_cost.c").write_text("#error broken\n#error again\n")
    with pytest.raises(LibraryError, match="broken") as refusal:
        open_library(folder, whole.bundle, flags=("-O0",))
    assert "\n" not in str(refusal.value)


def test_a_number_that_is_not_finite_is_the_controllers_failure(whole):
    library = open_library(whole.folder, whole.bundle, flags=FAST_BUILD)
    manifest = whole.bundle.manifest
    window = np.full((manifest.window, len(manifest.sensors) + 1), np.nan)
    with pytest.raises(ControllerError, match="not finite"):
        library.control_step(window, np.zeros(MPC.horizon), np.ones(MPC.horizon))


@pytest.mark.parametrize(("library", "said"), [("nothing", "No such file"), ("empty", r"sw_settings.h is missing")])
def test_the_command_refuses_a_folder_that_is_no_library(monkeypatch, capsys, tmp_path, whole, library, said):
    (tmp_path / "empty").mkdir()
    arguments = ["run", tmp_path / "run", "--bundle", whole.bundle_path, "--library", tmp_path / library]
    monkeypatch.setattr("sys.argv", ["stillwake", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        stillwake.__main__.main()
    line = capsys.readouterr().err
    assert stop.value.code == 1
    assert line.startswith(f"error: library {tmp_path / library}: ")
    assert said in line
    assert line.count("\n") == 1
    assert not (tmp_path / "run").exists()
