"""What no command can do is refused before the work: one line that names the value, status 1, and nothing written."""

import json
import shutil
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from contract.config.loading import to_tree
from contract.config.tree import Config
from contract.model.model_folder import DESCRIPTION, MODEL_SCHEMA
from contract.shipped import developed
from stillwake.commands import export as export_command
from wake.truck import truck_wake

MODEL = replace(Config(), mpc=replace(Config().mpc, iterations=7, weights=replace(Config().mpc.weights, lift=0.5)))
"""Settings that a model was trained with; neither the paper's nor the release's."""
ROOMS = {"contract", "wake", "train", "export", "can_bridge", "ecu", "firmware_sim", "stillwake"}


@pytest.fixture
def no_work(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """No plant is built and nothing is trained or exported."""
    before = set(sys.modules)

    def begun(*_: object, **__: object) -> None:
        raise AssertionError("the work began")

    monkeypatch.setattr(truck_wake, "TruckWake", begun)
    for name in ("train.pipeline", "export.release.pipeline", "wake.recording.recorder", "firmware_sim.mcu.measure"):
        monkeypatch.setitem(sys.modules, name, None)
    yield
    # What was imported meanwhile has `begun` for a plant; a later test in this process shall not meet it.
    for name in set(sys.modules) - before:
        if name.partition(".")[0] in ROOMS:
            del sys.modules[name]


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, random_release: Path) -> Path:
    """A working folder with what the calls below name."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("in the way")
    for name in ("folder", "folder.npz", "model", "mine", "c"):
        (tmp_path / name).mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("five years")
    (tmp_path / "c" / "sw_settings.h").write_text("")
    (tmp_path / "link").symlink_to("unsigned")
    (tmp_path / "s.npz").write_text("hours of work")
    # What `export` reads of a model before it loads torch.
    names = ("scaling", "layout", "sensors", "dataset_sha256", "metrics", "ranking", "versions", "weights_sha256")
    body = {"schema": MODEL_SCHEMA, "config": to_tree(MODEL), **dict.fromkeys(names)}
    (tmp_path / "model" / DESCRIPTION).write_text(json.dumps(body))
    for name in ("unsigned", "damaged"):
        shutil.copytree(random_release, tmp_path / name)
    graph = tmp_path / "damaged" / "controller.onnx"
    graph.write_bytes(graph.read_bytes() + b" ")
    (tmp_path / "flat.toml").write_text("x=1")
    (tmp_path / "state0").write_bytes(b"\x89HDF\r\n\x1a\n")
    return tmp_path


BEFORE_THE_WORK = {
    # A place that cannot be written.
    "develop /proc/self/out.npz": "/proc/self/out.npz",
    "develop folder.npz": "cannot write folder.npz: it is a directory",
    "export model file/out": "cannot write file/out",
    "develop new.npz --steady --json folder": "cannot write folder: it is a directory",
    # Nothing is replaced unless it was asked for.
    "develop s.npz": "s.npz: exists already; give --overwrite to replace it, or another name",
    "train model": "model: holds a model already; give --overwrite",
    "train mine --overwrite": "mine: exists and is not a model directory",
    "train m --json m/x.json": "m/x.json is the same path as m, or lies in it; name another place",
    "export model unsigned": "unsigned: holds the bundle random already, unsigned",
    "export model b --c c": "c: holds a C library already; give --overwrite",
    # Settings without an effect, that do not exist, or out of bounds.
    "develop x.npz --set mpc.iterations=3": "--set mpc.iterations: ",
    "record a.h5 --set train.epochs=3": "--set train.epochs: ",
    "export model b --set train.epochs=3": "--set train.epochs: ",
    "picture a.gif --set mpc.iterations=3": "--set mpc.iterations: ",
    "export nowhere b --set ecu": "section.key=value",
    "run r --set flat.toml": "no section",
    # Numbers, names and combinations that make no sense.
    "develop x.npz --duration nan": "--duration nan: must be a number of t_c",
    "develop x.npz --duration 0": "--duration 0: must be at least 0.2 t_c",
    "picture a.gif --forcing sine:frequency=nan": "frequency must be a positive number",
    "picture a.gif --field mean": "a.gif: the mean flow is a still picture",
    "picture a.xyz": "a.xyz: must be a file ending in .png, .pdf, .svg, .gif, .webp",
    "picture a.png --duration 1": "--forcing are only for --field mean or an animation",
    "develop a.npz --steady --duration 3": "--duration 3: does not go with --steady",
    "develop a.npz --json f": "--json: needs --steady",
    "develop a.npz --steady --json a.npz": "--json a.npz: this command reads or writes another file there",
    "train m --dataset s.npz --json s.npz": "--json s.npz: exists, but contains no figures of a command",
    "picture a.png --field mean --duration 1 --settle 1": "--settle 1.0: must be shorter",
    "record a.csv": "a.csv: a data set is an HDF5 file; its name must end in .h5 or .hdf5",
    "record a.h5 --under b --overwrite": "--overwrite does not go with --under",
    "train m --sensors upper_99": "unknown sensor 'upper_99'",
    "train m --sensors=": "unknown sensor ''",
    "train m --dataset nowhere.h5": "nowhere.h5: no such dataset",
    "export": "for the shipped bundle, give --c, --fmu, --image or",
    "export --c d --estimator": "for the shipped bundle, give --c, --fmu, --image or",
    "export unsigned --for-testers d --name x": "for the shipped bundle, give --c, --fmu, --image or",
    "export model --c d": "for the shipped bundle, give --c, --fmu, --image or",
    "export --c d --set ecu.loss_window=65": "ecu.loss_window = 65: the ECU in C accepts at most 64",
    "export model b --fmu d.fmu --set ecu.deadline_window=33": "ecu.deadline_window = 33: the ECU in C",
    "export --c d --set ecu.step_offset_ms=25": "ecu.step_offset_ms = 25: must be shorter than the control period",
    "export --fmu a.zip": "a.zip: must be a file ending in .fmu",
    "export --for-testers c --overwrite": "c: holds a C library already; name another folder",
    "export --c d --for-testers ./d": "d is the same path as d, or lies in it; name another place",
    "export model unsigned --overwrite --for-testers unsigned/d": "unsigned/d is the same path as unsigned, or",
    "export unsigned --for-testers unsigned/d": "unsigned/d is the same path as unsigned, or lies in it",
    "export model link --image unsigned/d.swi --overwrite": "unsigned/d.swi is the same path as link, or lies in it",
    "bundle inspect unsigned --sbom unsigned/d.json": "unsigned/d.json is the same path as unsigned, or lies in it",
    "export model b --image d.swi --name Zürich": "name 'Zürich': must be 1 to 64 printable ASCII characters",
    "export --image a.bin": "a.bin: must be a file ending in .swi or .hex or .s19",
    "export --fmu can:a.fmu": "can: must be one of bus, triggered, fmi2, windows",
    "export --fmu bus,fmi2:a.fmu": "bus and fmi2: FMI 2.0 has no bus",
    "plant-fmu bus:a.fmu": "bus: must be one of fmi2",
    "export --fmu file/a.fmu": "cannot write file/a.fmu",
    "plant-fmu a.fmu --set mpc.iterations=3": "--set mpc.iterations: ",
    "record a.h5 calm=5": "give --from-steady FILE as well",
    "record a.h5 --amplitudes 0.001 0.002": "give --from-steady FILE as well",
    "record a.h5 --episodes 2": "give --under BUNDLE or --from-steady",
    "record a.h5 training=-5": "training=-5: must be a number of control steps",
}
"""Calls that are refused before anything slow is loaded or built, and what their line names."""
WITH_THE_PLANT = {
    "record a.h5 training=0 chirp=0 uncontrolled=0": "nothing to record",
    "record a.h5 --under unsigned --paper": "--under and --paper are two recordings",
    "record a.h5 training=10 --under unsigned": "training=STEPS does not go with --under",
    "record a.h5 --under unsigned --exploration -0.1": "exploration = -0.1: must be finite and at least 0",
    "record a.h5 --under unsigned --set flow.action_limit=0.05": "for action limit 0.075, but the flow has 0.05",
    "record a.h5 --under damaged": "controller.onnx was altered",
    "record a.h5 chirp=5 --from-steady x.npz": "chirp=STEPS does not go with --from-steady: give calm=",
    "record a.h5 --from-steady x.npz --exploration 0.1": "--exploration: does not go with --from-steady",
    "record a.h5 --from-steady x.npz --state d.npz": "--state: does not go with --from-steady",
    "record a.h5 --from-steady x.npz --overwrite": "--overwrite does not go with --from-steady",
    "record a.h5 --from-steady x.npz --amplitudes 0.2 0.1": "0.2: must not exceed the largest, 0.1",
    "record a.h5 --set flow.reynolds=1000": "start_re1000.npz --set flow.reynolds=1000` makes a file for --state",
    f"record a.h5 --from-steady {developed()}": "not the steady wake: velocities differ from their mirror image",
    "run r --plant openfoam": "needs OpenFOAM's icoFoam: install the Debian package `openfoam`",
    "mcu nowhere": "nowhere: No such file or directory",
    "picture a.png --state state0": "state0 is not a flow state (damaged or not an NPZ file",
}
"""Calls that are refused by what they build or load."""


@pytest.mark.slow
@pytest.mark.usefixtures("place", "no_work")
def test_it_is_refused_before_the_work(all_refused) -> None:
    all_refused((), BEFORE_THE_WORK)


@pytest.mark.slow  # loads bundles and states, and builds the plant
def test_it_is_refused_by_what_does_the_work(all_refused, place, monkeypatch) -> None:
    monkeypatch.setenv("PATH", str(place))
    all_refused((), WITH_THE_PLANT)


def test_a_wrong_call_is_explained(cli, place) -> None:
    before = sorted(place.rglob("*"))
    for words, named in {
        "run": "--help",
        "run x y": "--help",
        "run x --nonsense": "--nonsense",
        "run x --lead-in 0": "--lead-in",
        "nonsense": "--help",
        "runn": "Did you mean 'run'?",
        "run x --plant water-tunnel": "--plant",
        "export --fmu d.fmu --set bus.key=k": "bus.key: an FMU cannot authenticate frames",
        "export model b --fmu d.fmu --set bus.key=k": "bus.key",
        "record a.h5 --seed -3": "--seed",
        "bundle renew a b --name n --key k --security-version 0": "--security-version",
        "bundle verify": "`bundle verify` is `stillwake bundle inspect` now",
        "run x --fault=ecu:drop": "`run --fault` is `--disturb` now",
        "can load --config a.toml": "`--config` is `--set FILE.toml` now",
    }.items():
        outcome = cli(*words.split())
        assert outcome.code == 2, words
        assert named in outcome.err and "Traceback" not in outcome.err, (words, outcome.err)
    assert sorted(place.rglob("*")) == before


def test_a_signed_bundle_is_named_as_such(refused, place, sound) -> None:
    line = refused("export", "model", shutil.copytree(sound, place / "signed"))
    assert "signed: holds the bundle random already, signed by key " in line
    assert "give --overwrite to replace it" in line


def test_an_export_begins_with_the_models_settings(place: Path) -> None:
    assert export_command._settings(Path("model"), []).mpc == MODEL.mpc
    (place / "few.toml").write_text("[mpc]\nhorizon = 9\n")
    given = export_command._settings(Path("model"), [str(place / "few.toml"), "mpc.weights.effort=2.0"]).mpc
    assert given == replace(MODEL.mpc, horizon=9, weights=replace(MODEL.mpc.weights, effort=2.0))
