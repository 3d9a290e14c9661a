"""The loop with the C library: the commands of ONNX Runtime, and no library but the bundle's.

Tolerances of a single answer are those of the export gates (`export.parity`, `export.quantisation_gate`), with random
weights held to the looser int8 limits that their releases are written with. Over a run the wire's resolution
(`FLOW_RESOLUTION_M2_PER_S`) comes on top: two actions on either side of a rounding boundary part by one step of it.
"""

import importlib.util
import json
import shutil
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np
import pytest

import stillwake
from can_bridge.message_specs import FLOW_RESOLUTION_M2_PER_S
from contract import bundle
from contract.config import BusConfig, Config, ModelConfig, MpcConfig
from contract.errors import LibraryError
from contract.host_library import host_compiler
from export.bundle_writer import write_release
from export.c_release import write_c_release
from export.calibrate import rounded_program
from export.onnx_weights import Precision
from export.quantisation_gate import QuantisationLimits
from export.random_program import random_program, random_window
from firmware_sim.closed_loop import run_closed_loop
from firmware_sim.controller import ControllerError, OnnxController
from firmware_sim.library_controller import LibraryController

try:
    host_compiler()
except LibraryError as error:
    pytest.skip(str(error), allow_module_level=True)

CONFIG = Config(bus=BusConfig(channel="library-loop"))
LENIENT = QuantisationLimits(rms_action_error=0.05, max_cost_gap=1.0)
MPC = MpcConfig(horizon=8)
PROGRAM = random_program(1, model=ModelConfig(latent=3, lstm_width=8, dynamics_width=16, decoder_width=8), mpc=MPC)
REACH = MPC.iterations * MPC.learning_rate
"""The way that Adam can take an action in one step."""
FAST_BUILD = ("-O1",)


@dataclass(frozen=True)
class Exported:
    bundle: bundle.Bundle
    bundle_path: Path
    folder: Path


def exported(root: Path, precision: Precision) -> Exported:
    """The bundle of `random_release` in either precision, and the C library of the same export."""
    rng = np.random.default_rng(0)
    series = np.concatenate([random_window(PROGRAM, rng) for _ in range(2)])
    windows = [series[i : i + PROGRAM.window] for i in range(PROGRAM.window)]
    write_c_release(
        root / "c", PROGRAM, precision=precision, windows=windows[:4], calibration=windows, limits=LENIENT
    )
    write_release(
        root / "bundle",
        PROGRAM,
        precision=precision,
        name="random",
        operating_point=CONFIG.operating_point,
        budget_ms=CONFIG.period_ns / 1e6,
        compute_time_ms=CONFIG.ecu.compute_time_ms,
        control_period=CONFIG.flow.control_period,
        created=date(2026, 1, 2),
        dataset_sha256="0" * 64,
        weights_sha256="0" * 64,
        provenance={},
        windows=windows[:4],
        calibration=windows,
        limits=LENIENT,
    )
    return Exported(bundle.load(root / "bundle"), root / "bundle", root / "c")


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Exported:
    return exported(tmp_path_factory.mktemp("float32"), "float32")


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Exported:
    return exported(tmp_path_factory.mktemp("int8"), "int8")


def commands(release: Exported, folder: Path, controller: LibraryController | None) -> np.ndarray:
    """What the ECU sends in ten controlled periods on the real wake, U_inf W."""
    log = run_closed_loop(
        folder, release.bundle, CONFIG, lead_in=7.0, controlled=2.0, settle=0.2, controller=controller
    )
    return log.series["command"][log.enabled_at :]


def test_in_float32_the_loop_gets_the_commands_of_onnx(whole, tmp_path):
    library = LibraryController(whole.folder, whole.bundle, flags=FAST_BUILD)
    with_onnx, with_c = commands(whole, tmp_path / "onnx", None), commands(whole, tmp_path / "c", library)
    resolution = FLOW_RESOLUTION_M2_PER_S / CONFIG.operating_point.flow_rate_scale
    np.testing.assert_allclose(with_c, with_onnx, rtol=0, atol=5e-3 * REACH + resolution)
    assert np.abs(with_onnx).max() > 0.1 * REACH
    found = [json.loads((tmp_path / name / "summary.json").read_text()) for name in ("onnx", "c")]
    assert found[0]["computed_by"].startswith("ONNX Runtime")
    assert found[1]["computed_by"] == library.description
    assert "C99 float32" in library.description
    assert "-O1" in library.description
    assert found[1]["mpc_ms_p50"] > 0


def test_in_int8_its_answers_pass_the_int8_gate(small):
    """Against the ONNX graph with the same int8 weights; what differs is the rounding of activations. The plans of a
    random net are held to what the parity test of the int8 library holds them to."""
    library = LibraryController(small.folder, small.bundle, flags=FAST_BUILD)
    onnx = OnnxController(small.bundle)
    rng = np.random.default_rng(2)
    plan, free, errors = np.zeros(MPC.horizon), np.ones(MPC.horizon), []
    for _ in range(20):
        window = random_window(PROGRAM, rng)
        expected, found = (controller.control_step(window, plan, free) for controller in (onnx, library))
        errors.append(found.plan - expected.plan)
        assert np.abs(found.forces - expected.forces).max() < 5e-3
        plan = expected.plan
    assert 0 < np.sqrt(np.mean(np.square(errors))) < 0.05 * REACH


def test_the_library_of_another_program_is_refused(whole, small):
    """The int8 library is another program than the float one: its weights are rounded."""
    with pytest.raises(LibraryError) as refusal:
        LibraryController(small.folder, whole.bundle)
    rounded = small.bundle.manifest.program_sha256
    assert rounded[:12] in str(refusal.value)
    assert whole.bundle.manifest.program_sha256[:12] in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert rounded != whole.bundle.manifest.program_sha256


def test_calibration_is_part_of_the_program(small):
    """Which other windows would have rounded differently; the hash is that of what was rounded."""
    from export.program_hash import program_sha256

    assert program_sha256(rounded_program(PROGRAM)) != small.bundle.manifest.program_sha256


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
        LibraryController(folder, whole.bundle)


def test_without_a_compiler_the_line_says_so(whole, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(LibraryError, match="no C compiler: install gcc or clang"):
        LibraryController(whole.folder, whole.bundle)


def test_a_compiler_that_does_not_run_is_named(whole, monkeypatch):
    monkeypatch.setenv("CC", "/nowhere/gcc")
    with pytest.raises(LibraryError, match="/nowhere/gcc: No such file"):
        LibraryController(whole.folder, whole.bundle)


def test_sources_that_do_not_compile_are_one_line(whole, tmp_path):
    folder = tmp_path / "c"
    shutil.copytree(whole.folder, folder)
    (folder / "sw_cost.c").write_text("#error broken\n#error again\n")
    with pytest.raises(LibraryError, match="broken") as refusal:
        LibraryController(folder, whole.bundle, flags=("-O0",))
    assert "\n" not in str(refusal.value)


def test_a_number_that_is_not_finite_is_the_controllers_failure(whole):
    library = LibraryController(whole.folder, whole.bundle, flags=FAST_BUILD)
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
        stillwake.main()
    line = capsys.readouterr().err
    assert stop.value.code == 1
    assert line.startswith(f"error: library {tmp_path / library}: ")
    assert said in line
    assert line.count("\n") == 1
    assert not (tmp_path / "run").exists()
