"""Where results go: a place that cannot be written is noticed before the work, and nothing is replaced unasked."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from contract.config.loading import to_tree
from contract.config.tree import Config
from contract.model.model_folder import DESCRIPTION, SCHEMA
from stillwake.commands import export as export_command
from wake.truck import truck_wake

MODEL = replace(Config(), mpc=replace(Config().mpc, iterations=7, weights=replace(Config().mpc.weights, lift=0.5)))
"""Settings that a model was trained with; neither the paper's nor the release's."""


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """What `export` reads of a model before it loads torch."""
    folder = tmp_path / "model"
    folder.mkdir()
    names = ("scaling", "layout", "sensors", "dataset_sha256", "metrics", "ranking", "versions", "weights_sha256")
    body = {"schema": SCHEMA, "config": to_tree(MODEL), **dict.fromkeys(names)}
    (folder / DESCRIPTION).write_text(json.dumps(body))
    return folder


ROOMS = {"contract", "wake", "train", "export", "can_bridge", "firmware_sim", "stillwake"}


@pytest.fixture(autouse=True)
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


WRITERS = {
    ("develop",): ".npz",
    ("steady",): ".npz",
    ("record",): ".h5",
    ("train",): "",
    ("export",): "",
    ("picture", "vorticity"): ".png",
    ("picture", "mean"): ".png",
    ("animate",): ".gif",
}


@pytest.mark.parametrize("verb", WRITERS, ids=" ".join)
@pytest.mark.parametrize("place", ["/proc/self/out", "a file in place of a folder", "the other kind"])
def test_a_place_that_cannot_be_written_is_noticed_before_the_work(
    refused: Callable[..., str], tmp_path: Path, model: Path, verb: tuple[str, ...], place: str
) -> None:
    suffix = WRITERS[verb]
    (tmp_path / "file").write_text("in the way")
    if place == "/proc/self/out":
        output = Path(place + suffix)
    elif place == "a file in place of a folder":
        output = tmp_path / "file" / f"out{suffix}"
    else:
        output = tmp_path / f"out{suffix}"
        if suffix:
            output.mkdir()
        else:
            output.write_text("in the way")
    line = refused(*verb, *([model] if verb == ("export",) else []), output)
    assert str(output) in line
    assert "cannot write" in line or "must be a file" in line


@pytest.mark.parametrize("verb", [["steady", "s.npz"], ["train", "m"], ["mcu", "library"], ["run", "r"]])
def test_so_is_a_place_for_the_figures(
    refused: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, verb: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert f"cannot write {tmp_path}: it is a directory" in refused(*verb, "--json", tmp_path)


@pytest.mark.parametrize("verb", ["develop", "steady"])
def test_a_state_is_not_replaced_unasked(refused: Callable[..., str], tmp_path: Path, verb: str) -> None:
    output = tmp_path / "s.npz"
    output.write_text("hours of work")
    line = refused(verb, output)
    assert line == f"error: {output}: there is one already; give --overwrite to replace it, or another name\n"
    assert output.read_text() == "hours of work"


def test_a_model_is_not_replaced_unasked(refused: Callable[..., str], model: Path, tmp_path: Path) -> None:
    assert f"{model}: there is a model already; give --overwrite" in refused("train", model)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("five years")
    for more in ([], ["--overwrite"]):
        assert "exists and is not a model directory" in refused("train", tmp_path / "mine", *more)


def test_a_signed_bundle_is_named_as_such(
    refused: Callable[..., str], model: Path, signed: Path, random_release: Path, tmp_path: Path
) -> None:
    line = refused("export", model, signed)
    assert f"{signed}: there is the bundle random already, signed by key " in line
    assert "give --overwrite to replace it" in line
    unsigned = shutil.copytree(random_release, tmp_path / "unsigned")
    assert "there is the bundle random already, unsigned" in refused("export", model, unsigned)


def test_a_c_library_is_not_replaced_unasked(refused: Callable[..., str], model: Path, tmp_path: Path) -> None:
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "sw_settings.h").write_text("")
    line = refused("export", model, tmp_path / "bundle", "--c", tmp_path / "c")
    assert f"{tmp_path / 'c'}: there is a C library already; give --overwrite" in line


def test_an_export_begins_with_the_models_settings(model: Path, tmp_path: Path) -> None:
    assert export_command._settings(model, None, []).mpc == MODEL.mpc
    file = tmp_path / "few.toml"
    file.write_text("[mpc]\nhorizon = 9\n")
    found = export_command._settings(model, file, ["mpc.weights.effort=2.0"]).mpc
    weights = replace(MODEL.mpc.weights, effort=2.0)
    assert found == replace(MODEL.mpc, horizon=9, weights=weights)


@pytest.mark.parametrize(
    ("verb", "setting"),
    [
        (["develop", "s.npz"], "mpc.iterations=3"),
        (["steady", "s.npz"], "forcing.base_frequency=0.3"),
        (["record", "a.h5"], "train.epochs=3"),
        (["train", "m"], "vehicle.actuator_delay=3"),
        (["export", "model", "b"], "train.epochs=3"),
        (["picture", "vorticity", "a.png"], "forcing.base_frequency=0.3"),
        (["animate", "a.gif"], "mpc.iterations=3"),
    ],
)
def test_a_setting_without_effect_is_refused(
    refused: Callable[..., str],
    model: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    verb: list[str],
    setting: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert f"--set {setting.split('=')[0]}: " in refused(*verb, "--set", setting)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["develop", "s.npz", "--duration", "nan"], "--duration nan: must be a number of t_c"),
        (["develop", "s.npz", "--duration", "inf"], "--duration inf: must be a number of t_c"),
        (["develop", "s.npz", "--duration", "-5"], "--duration -5: must be at least 0.2 t_c"),
        (["develop", "s.npz", "--duration", "0"], "--duration 0: must be at least 0.2 t_c"),
        (["animate", "a.gif", "--duration", "1e300"], "--duration 1e+300: must be a number of t_c"),
        (["animate", "a.gif", "--skip", "inf"], "--skip inf: must be a number of t_c"),
        (["animate", "a.gif", "--frequency", "nan"], "--frequency nan: must be a positive number"),
        (["animate", "a.gif", "--forcing", "sine", "--amplitude", "nan"], "amplitude = nan: must be between"),
        (["picture", "mean", "a.png", "--settle", "inf"], "--settle inf: must be a number of t_c"),
        (["record", "a.csv"], "a.csv: a data set is an HDF5 file; its name must end in .h5 or .hdf5"),
        (["record", "a.h5", "--under", "b", "--overwrite"], "--overwrite does not go with --under"),
        (["train", "m", "--sensors", "upper_99"], "unknown sensor 'upper_99'"),
        (["train", "m", "--dataset", "nowhere.h5"], "nowhere.h5: no such dataset"),
    ],
)
def test_what_makes_no_sense_is_named(
    refused: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], named: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert named in refused(*arguments)


@pytest.mark.parametrize(
    "arguments",
    [
        ["record", "a.h5", "--training", "-5"],
        ["record", "a.h5", "--chirp", "-1"],
        ["record", "a.h5", "--seed", "-3"],
        ["animate", "a.gif", "--forcing", "training", "--seed", "-1"],
        ["picture", "mean", "a.png", "--seed", "-1"],
    ],
)
def test_a_negative_number_is_refused_by_its_option(
    cli: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = cli(*arguments)
    assert outcome.code == 2
    assert arguments[-2] in outcome.err
    assert "Traceback" not in outcome.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", [b"\x89HDF\r\n\x1a\n" + bytes(64), b"PK\x03\x04" + bytes(64), b"", b"text\n"])
def test_a_state_of_another_kind_is_named_without_advice_to_unpickle_it(
    refused: Callable[..., str], tmp_path: Path, content: bytes
) -> None:
    state = tmp_path / "my.h5"
    state.write_bytes(content)
    line = refused("picture", "vorticity", tmp_path / "a.png", "--state", state)
    assert line == f"error: {state}: not a flow state (another kind of file, or damaged)\n"


@pytest.mark.processes
@pytest.mark.parametrize("extra", ["h5py", "torch", "numba", "scipy", "matplotlib", "distributed"])
def test_the_command_line_starts_without_what_a_vehicle_does_not_install(extra: str) -> None:
    script = f"import sys; sys.modules[{extra!r}] = None; import stillwake.__main__"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
