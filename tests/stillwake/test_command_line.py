"""The command line as a user meets it: what goes wrong is one line, a non-zero exit, and nothing half-written."""

import json
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import h5py
import numpy as np
import pytest

import stillwake.__main__
from contract.recording import dataset
from contract.shipped import RECORDING
from tests.stillwake.verbs import verbs

VERBS = verbs(stillwake.__main__.app)


def test_the_verbs_are_there():
    assert {"record", "train", "export", "run", "report"} <= set(VERBS)


@pytest.mark.parametrize("option", ["-h", "--help"])
@pytest.mark.parametrize("verb", [*VERBS, "bundle", "bundle verify", "picture", "picture mean"])
def test_every_verb_explains_itself(cli, verb, option):
    outcome = cli(*verb.split(), option)
    assert outcome.code == 0
    assert f"stillwake {verb}" in outcome.out
    assert outcome.err == ""


def test_the_first_page_says_what_the_letters_mean(cli):
    text = " ".join(cli("--help").out.split())
    assert all(
        word in text for word in ("W, the body's width", "t_c = W / U_inf", "Cp that of pressure", "An action is")
    )


def test_the_lines_of_a_help_fill_the_terminal(cli, monkeypatch):
    monkeypatch.setattr("typer.rich_utils.MAX_WIDTH", 80)
    about = cli("train", "--help").out.partition("Arguments")[0].rpartition("\n")[0]
    for paragraph in re.split(r"\n +\n", about)[2:]:
        *full, _last = paragraph.rstrip().splitlines()
        assert all(len(line.rstrip()) > 60 for line in full), paragraph


def test_the_version_is_the_installed_one(cli):
    assert cli("--version").out == f"stillwake {version('stillwake')}\n"


def test_a_misspelt_verb_is_answered_with_the_nearest(cli):
    outcome = cli("runn")
    assert outcome.code == 2
    assert "Did you mean 'run'?" in outcome.err


def test_openfoam_that_is_not_installed_is_named(refused, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    line = refused("run", tmp_path / "run", "--plant", "openfoam")
    assert "needs OpenFOAM's icoFoam: install the Debian package `openfoam`" in line


def test_an_unknown_plant_is_refused(refused, tmp_path):
    assert "must be stillwake or openfoam" in refused("run", tmp_path / "run", "--plant", "water-tunnel")


def test_a_missing_library_for_the_microcontroller_is_one_line(refused, tmp_path):
    assert "nothing-here: No such file or directory" in refused("mcu", tmp_path / "nothing-here")


def test_without_a_verb_it_lists_them(cli):
    outcome = cli()
    assert outcome.code != 0
    assert all(verb in outcome.out + outcome.err for verb in VERBS)
    assert "Traceback" not in outcome.err


@pytest.mark.parametrize(
    "arguments",
    [["run"], ["run", "x", "y"], ["run", "x", "--nonsense"], ["nonsense"], ["run", "x", "--lead-in", "0"]],
)
def test_a_wrong_call_is_explained_without_a_traceback(cli, arguments):
    outcome = cli(*arguments)
    assert outcome.code == 2
    assert "--help" in outcome.err
    assert not Path("x").exists()


def test_a_missing_bundle(refused, tmp_path):
    line = refused("run", tmp_path / "run", "--bundle", tmp_path / "nowhere")
    assert f"bundle {tmp_path}/nowhere: no such directory or zip" in line


@pytest.mark.parametrize("name", ["controller.onnx", "manifest.json"])
@pytest.mark.parametrize("place", [0.0, 0.5, 0.999])
def test_a_tampered_bundle(refused, tmp_path, random_release, name, place):
    bundle = tmp_path / "bundle"
    shutil.copytree(random_release, bundle)
    data = bytearray((bundle / name).read_bytes())
    data[int(place * len(data))] ^= 0x01
    (bundle / name).write_bytes(data)
    line = refused("run", tmp_path / "run", "--bundle", bundle)
    assert name in line
    assert "altered" in line or "damaged" in line


def test_a_bundle_for_another_vehicle(refused, tmp_path, random_release):
    settings = ["--set", "operating_point.speed=20.0"]
    line = refused("run", tmp_path / "run", "--bundle", random_release, *settings)
    assert "operating point" in line
    assert "speed 20.0" in line


@pytest.fixture
def recording(tmp_path) -> Path:
    """A copy of the shipped recording."""
    path = tmp_path / "recording.h5"
    shutil.copy(RECORDING, path)
    return path


def test_a_recording_with_nan(refused, tmp_path, recording):
    with h5py.File(recording, "r+") as file:
        episode = next(iter(file["episodes"]))
        node = file["episodes"][episode]
        values = node["Cp"][:] * node["Cp"].attrs["quantum"]
        values[7, 3] = np.nan
        del node["Cp"]
        node.create_dataset("Cp", data=values).attrs["units"] = "1"
    line = refused("train", tmp_path / "model", "--dataset", recording)
    assert f"episode {episode}: field 'Cp' holds a value that is not finite, first at step 7" in line


def test_a_recording_with_a_sensor_too_few(refused, tmp_path, recording):
    with h5py.File(recording, "r+") as file:
        node = next(iter(file["episodes"].values()))
        attributes, values = dict(node["Cp"].attrs), node["Cp"][:, :89]
        del node["Cp"]
        node["Cp"] = values
        node["Cp"].attrs.update(attributes)
    line = refused("train", tmp_path / "model", "--dataset", recording)
    assert f"'Cp' has shape ({len(values)}, 89), must be ({len(values)}, 90)" in line


def test_a_recording_of_other_sensors(refused, tmp_path, recording):
    with h5py.File(recording, "r+") as file:
        file.attrs["sensors"] = json.dumps(["base_0"])
    assert "other sensors" in refused("train", tmp_path / "model", "--dataset", recording)


def test_a_missing_recording(refused, tmp_path):
    assert "no such dataset" in refused("train", tmp_path / "model", "--dataset", tmp_path / "nowhere.h5")


def test_an_output_that_cannot_be_written(refused, tmp_path, random_release):
    (tmp_path / "file").write_text("")
    inside = tmp_path / "file" / "out"
    assert f"cannot write {inside}" in refused("run", inside, "--bundle", random_release)
    assert f"cannot write {inside}.h5" in refused("record", inside.with_suffix(".h5"), "--training", 3)
    # A run needs a folder, a recording a file.
    assert "cannot write" in refused("run", tmp_path / "file", "--bundle", random_release)
    (tmp_path / "folder").mkdir()
    assert "is a directory" in refused("record", tmp_path / "folder", "--training", 3)


def test_nothing_to_record(refused, tmp_path):
    none = ["--training", 0, "--chirp", 0, "--uncontrolled", 0]
    assert "nothing to record" in refused("record", tmp_path / "a.h5", *none)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--paper"], "--under and --paper are two recordings"),
        (["--training", 10], "--training does not go with --under"),
        (["--role", "test"], "role = 'test': must be one of train, controlled"),
        (["--exploration", -0.1], "exploration = -0.1: must be finite and at least 0"),
        (["--set", "flow.action_limit=0.05"], "built for another action limit: 0.075, the flow has 0.05"),
        (["--set", "flow.control_period=0.1"], "built for another control period: 0.2, the flow has 0.1"),
        (["--set", "forcing.exploration_time=0.0"], "forcing.exploration_time = 0.0: must be positive"),
    ],
)
def test_a_recording_under_a_controller_that_makes_no_sense(refused, tmp_path, random_release, arguments, named):
    assert named in refused("record", tmp_path / "a.h5", "--under", random_release, *arguments)


def test_a_recording_under_a_controller_that_is_not_there_or_altered(refused, tmp_path, random_release):
    line = refused("record", tmp_path / "a.h5", "--under", tmp_path / "nowhere")
    assert f"bundle {tmp_path}/nowhere: no such directory or zip" in line
    bundle = tmp_path / "bundle"
    shutil.copytree(random_release, bundle)
    (bundle / "controller.onnx").write_bytes((bundle / "controller.onnx").read_bytes() + b" ")
    assert "controller.onnx was altered" in refused("record", tmp_path / "a.h5", "--under", bundle)
    assert "give --under or --from-steady" in refused("record", tmp_path / "a.h5", "--episodes", 2)


def test_the_first_schema_takes_no_rounds(refused, recording, random_release):
    with h5py.File(recording, "r+") as file:
        file.attrs["schema"] = "stillwake-dataset/1"
        for node in file["episodes"].values():
            del node["Cd_slot_viscous"]
            node.move("Cd_slot_pressure", "Cd_slot")
    line = refused("record", recording, "--under", random_release)
    assert "episodes can only be added to 'stillwake-dataset/3'" in line


@pytest.mark.slow
def test_rounds_under_a_controller_are_added(cli, tmp_path, random_release):
    output = tmp_path / "a.h5"
    for number in (1, 2):
        outcome = cli(
            "record", output, "--under", random_release, "--controlled", 2, "--episodes", 1, "--role", "train"
        )
        assert (outcome.code, outcome.err) == (0, "")
        assert f"round {number}, 2 control steps under the controller" in outcome.out.replace("\n", " ")
    found = dataset.read(output).episodes
    assert [(one.name, one.role, len(one)) for one in found] == [
        ("controlled_1_0", "train", 2),
        ("controlled_2_0", "train", 2),
    ]
    assert found[0].provenance["bundle"] == "random"
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]


@pytest.mark.parametrize("verb", ["record", "train", "export", "run", "develop"])
@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ("nonsense.key=1", "nonsense"),
        ("ecu.nonsense=1", "nonsense"),
        ("ecu", "section.key=value"),
        ("ecu=3", "ecu is a section: write ecu.key=value"),
        ("ecu.compute_time=0", "ecu has no 'compute_time': did you mean compute_time_ms?"),
        ("ecu.compute_time_ms=abc", "ecu.compute_time_ms = 'abc': must be a number"),
        ("ecu.hold_periods=-1", "ecu.hold_periods = -1: must be non-negative"),
    ],
)
def test_a_setting_that_does_not_exist(refused, tmp_path, verb, setting, named):
    outputs = [tmp_path / "in", tmp_path / "out"] if verb == "export" else [tmp_path / "out"]
    assert named in refused(verb, *outputs, "--set", setting)


@pytest.mark.parametrize("verb", ["run", "record", "config"])
@pytest.mark.parametrize(
    ("content", "line"),
    [
        (None, "No such file or directory"),
        (b"\x00\xff", "no text in UTF-8"),
        (b"[ecu", "Expected ']'"),
        (b"x=1", "no section"),
    ],
)
def test_a_file_of_settings_that_is_none(refused, tmp_path, verb, content, line):
    path = tmp_path / "mine.toml"
    if content is not None:
        path.write_bytes(content)
    outputs = [] if verb == "config" else [tmp_path / "out"]
    assert line in (said := refused(verb, *outputs, "--config", path))
    assert f"configuration {path}: " in said


def test_a_folder_without_a_run(refused, tmp_path):
    assert "series.npz" in refused("report", tmp_path)


@pytest.mark.slow
def test_a_run_and_its_report(cli, tmp_path, random_release):
    folder = tmp_path / "run"
    outcome = cli("run", folder, "--bundle", random_release, "--lead-in", 0.4, "--controlled", 0.4, "--no-averages")
    # The window was never full, so the controller was never in control: status 3.
    assert (outcome.code, outcome.err) == (3, "")
    assert "No averages were asked for" in outcome.out
    assert outcome.out.count("warning: ") == outcome.out.count("warning: unsigned: ") == 1
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["frames_sent"], summary["frames_lost"], summary["signer"]) == (8, 0, None)
    assert summary["mpc_ms_p50"] is None
    (folder / "report.html").unlink()
    assert cli("report", folder).code == 0
    assert (folder / "report.html").is_file()


# Shells start background jobs deaf to Ctrl-C, and a test may run in one. Blocks of the shipped size take too long.
BOOTSTRAP = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from wake.recording import recorder
recorder.record.__kwdefaults__["block_steps"] = 8
import stillwake.__main__
stillwake.__main__.main()
"""


def start(*arguments: object) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-c", BOOTSTRAP, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def stop_after(process: subprocess.Popen, seen: Callable[[], bool]) -> subprocess.CompletedProcess[str]:
    """Press Ctrl-C as soon as something is seen."""
    deadline = time.monotonic() + 120.0
    try:
        while not seen():
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120.0)
    finally:
        process.kill()
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)


@pytest.mark.processes
def test_a_recording_stopped_by_ctrl_c_continues(tmp_path):
    output, parts = tmp_path / "a.h5", tmp_path / "a.h5.parts"
    command = ["record", output, "--training", 20, "--chirp", 0, "--uncontrolled", 0]
    first = parts / "training_1" / "000000.npz"
    outcome = stop_after(start(*command), first.is_file)
    advice = "a.h5.parts keeps what is recorded, the same command continues it"
    assert (outcome.returncode, outcome.stderr) == (130, f"stopped; {advice}\n")
    assert "wrote" not in outcome.stdout
    assert not output.exists()
    assert {path.suffix for path in parts.rglob("*") if path.is_file()} == {".npz", ".json"}
    made = first.stat().st_mtime_ns

    process = start(*command)
    stamps = set()
    while process.poll() is None:
        if first.is_file():
            stamps.add(first.stat().st_mtime_ns)
        time.sleep(0.01)
    assert process.stderr is not None
    assert (process.returncode, process.stderr.read()) == (0, "")
    assert stamps == {made}
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]
    assert len(dataset.read(output).episodes[0]) == 20


@pytest.mark.processes
def test_a_run_stopped_by_ctrl_c_leaves_nothing(tmp_path, random_release):
    process = start(
        "run", tmp_path / "run", "--bundle", random_release, "--lead-in", 0.4, "--controlled", 1000, "--no-averages"
    )
    # Drawn when control is requested.
    outcome = stop_after(process, lambda: any(tmp_path.glob("run/*vorticity_uncontrolled*")))
    assert (outcome.returncode, outcome.stderr) == (130, "stopped\n")
    assert "wrote" not in outcome.stdout
    assert list(tmp_path.iterdir()) == []
