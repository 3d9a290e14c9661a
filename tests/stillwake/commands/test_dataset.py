"""`stillwake dataset`: a user's own files, from the command line; one line and status 1 for what is wrong."""

import tomllib
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path

import h5py
import numpy as np
import pytest

from contract.config.loading import load_config
from contract.recording import dataset
from contract.recording.findings import findings
from tests import foreign_plant
from tests import oscillating_wake as wake
from tests.conftest import Outcome
from tests.foreign_plant import LIMIT, NAMES, PERIOD

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(cli: Callable[..., Outcome]) -> Run:
    """Call `stillwake dataset ...`: status, output and errors."""
    return lambda *words: astuple(cli("dataset", *words))


@pytest.fixture
def files(tmp_path: Path) -> list[object]:
    """The words that import three files of three kinds."""
    sensors = foreign_plant.write_sensors(tmp_path / "sensors.csv")
    sweep = foreign_plant.write_csv(tmp_path / "sweep.csv", foreign_plant.series(300, 1))
    calm = foreign_plant.write_npz(tmp_path / "calm.npz", foreign_plant.series(200, 2, forced=False))
    held_out = foreign_plant.write_hdf5(tmp_path / "held out.h5", foreign_plant.series(150, 3))
    return [
        *("--layout", sensors, f"train={sweep}", f"train={calm}", f"test={held_out}", "--asymmetric"),
        *("--set", f"flow.control_period={PERIOD}", "--set", f"flow.action_limit={LIMIT}"),
    ]


@pytest.fixture
def made(run: Run, files: list[object], tmp_path: Path) -> Path:
    status, _, errors = run("import", tmp_path / "my.h5", *files)
    assert (status, errors) == (0, "")
    return tmp_path / "my.h5"


def test_an_imported_data_set_is_fit_and_its_settings_fit_it(run: Run, made: Path, tmp_path: Path) -> None:
    read = dataset.read(made)
    assert [(item.name, item.role, len(item)) for item in read.episodes] == [
        ("sweep", "train", 300),
        ("calm", "train", 200),
        ("held out", "test", 150),
    ]
    assert read.layout.names == NAMES
    status, output, _ = run("inspect", made)
    assert status == 0
    assert "fit for training and export" in output
    status, output, _ = run("inspect", made, "--settings")
    (tmp_path / "my.toml").write_text(output)
    assert tomllib.loads(output)["flow"] == {"control_period": PERIOD, "action_limit": LIMIT}
    config = load_config(tmp_path / "my.toml", [])
    assert [item.text for item in findings(read, config) if item.stops] == []
    calm = read.episodes[1].series["Cd"]
    assert config.mpc.drag_reference == pytest.approx(calm.mean(), rel=1e-5)


@pytest.mark.slow
def test_it_lists_episodes_sensors_and_facts_and_draws(run: Run, made: Path, tmp_path: Path) -> None:
    status, output, _ = run("inspect", made, "--picture", tmp_path / "a.png")
    assert status == 0
    for word in ("sweep", "held out", "lid-left", "control period 0.3", "reynolds not known", "without mirror images"):
        assert word in output
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    status, _, errors = run("inspect", made, "--picture", tmp_path / "a.jpg")
    assert status == 1
    assert "must end in .png" in errors


def test_a_file_that_is_there_is_replaced_only_when_asked_and_a_source_never(
    cli: Callable[..., Outcome], refused: Callable[..., str], made: Path, files: list[object], tmp_path: Path
) -> None:
    call = ("dataset", "import")
    assert "--overwrite" in refused(*call, made, *files)
    assert cli(*call, made, *files, "--set", "flow.reynolds=90", "--overwrite").code == 0
    assert dataset.read(made).plant.reynolds == 90.0
    source = tmp_path / "held out.h5"
    line = f"error: {source}: is one of the files to read; give another name\n"
    assert refused(*call, source, *files, "--overwrite") == line
    (tmp_path / "round.h5").symlink_to("round.h5")
    assert "cannot write" in refused(*call, tmp_path / "round.h5", *files, "--overwrite")
    assert "round.h5: no such file" in refused(*call, tmp_path / "new.h5", *files, f"test={tmp_path / 'round.h5'}")
    named = "a data set is an HDF5 file; its name must end in .h5 or .hdf5"
    assert named in refused(*call, tmp_path / "my.csv", *files)
    assert "'Cl': must be NAME=VALUE, such as Cd=drag_coefficient" in refused(
        *call, tmp_path / "other.h5", *files, "--map", "Cl"
    )
    # Nothing is written unless every file fits.
    text = (tmp_path / "sweep.csv").read_text().splitlines()
    text[40] = text[40].replace(text[40].split(",")[3], "")
    (tmp_path / "sweep.csv").write_text("\n".join(text))
    line = refused(*call, tmp_path / "other.h5", *files)
    assert "sweep.csv: line 41, column 'Cl': '' is not a number" in line


@pytest.mark.slow  # an import and a check a case
def test_numbers_that_cannot_be_are_noted_and_packed_ones_unpacked(
    run: Run, refused: Callable[..., str], tmp_path: Path
) -> None:
    (tmp_path / "sensors.csv").write_text(wake.SENSORS)
    facts = ("--set", "flow.control_period=0.3", "--set", "flow.action_limit=0.2")
    packing = {"Cp": (0.02, -0.4), "Cd": (0.004, 1.0), "Cl": (0.02, 0.0)}

    def words(scales: dict[str, float], packed: bool, gap: bool = False) -> list[object]:
        """Write the files of a case, and name them."""
        found: list[object] = [
            tmp_path / "o.h5",
            "--layout",
            tmp_path / "sensors.csv",
            *facts,
        ]
        for name, how in wake.FILES.items():
            values = {key: one * scales.get(key, 1.0) for key, one in wake.series(*how).items()}
            path = tmp_path / f"{name}.{'h5' if packed else 'csv'}"
            path.write_text(wake.table(values))
            if packed:
                with h5py.File(path, "w") as file:
                    for key, one in values.items():
                        scale, offset = packing.get(key, (1.0, 0.0))
                        file[key] = np.round((one - offset) / scale).astype(np.int8) if key in packing else one
                        file[key].attrs.update(scale_factor=scale, add_offset=offset, _FillValue=np.int8(-128))
                    if gap:
                        file["Cd"][50:56] = -128
            found.append(f"{'test' if name == 'held_out' else 'train'}={path}")
        return found

    settings = (*facts, "--set", "model.window=32")
    units = ("--reference", "t=5ms", "--reference", "Cd=-40N")
    for scales, packed, more, notes in (
        ({}, True, (), ()),
        ({}, False, ("--reference", "Cp=75Pa"), ("all Cp are within 0.01", "divided by 75", "no --reference Cp")),
        ({"Cp": 75.0}, False, ("--reference", "Cp=75Pa"), ()),
        ({"t": 5.0, "Cd": -40.0}, False, units, ()),
        ({"Cd": -1.0}, False, (), ("mean Cd is -1.34", "--reference Cd=-1")),
    ):
        status, output, errors = run("import", *words(scales, packed), *more, "--overwrite")
        checked = run("inspect", tmp_path / "o.h5", *settings)
        assert (status, errors, checked[0], checked[2]) == (0, "", 0, "")
        for text in (" ".join(output.split()), " ".join(checked[1].split())):
            assert all(note in text for note in notes) and ("note" in text) == bool(notes), text
        sweep = dataset.read(tmp_path / "o.h5").episodes[0].series
        assert abs(sweep["Cd"].mean()) == pytest.approx(1.339, abs=2e-3)
        assert sweep["Cp"].mean() == pytest.approx(-0.401 / (75 if notes[2:] else 1), abs=1e-3)
    (tmp_path / "o.h5").unlink()
    line = refused("dataset", "import", *words({}, True, gap=True))
    assert "sweep.h5: array 'Cd' holds a value, -128, that is missing by its _FillValue, first at step 50" in line
    assert not (tmp_path / "o.h5").exists()


def test_settings_that_do_not_agree_are_wrong_where_they_are_given(run: Run, made: Path) -> None:
    status, output, _ = run("inspect", made, "--set", "flow.control_period=0.2", "--set", "flow.action_limit=0.2")
    assert status == 1
    assert "control period is 0.3 in the data set, flow.control_period = 0.2" in output
    # What is damaged is reported with what does not fit.
    with h5py.File(made, "r+") as file:
        del file["episodes/calm"].attrs["provenance"]
        file["episodes/sweep/action"][7] = -0.4
    status, output, errors = run("inspect", made)
    assert (status, "2 things to put right" in errors) == (1, True)
    assert "'provenance' is missing" in output and "action is -0.4 at step 7" in output


def test_the_settings_that_fit_are_not_written_over_a_file_of_the_user(run: Run, made: Path) -> None:
    """The hint has a redirection that would replace the file."""
    kept = made.with_suffix(".toml")
    _, output, _ = run("inspect", made)
    assert f"--settings > {kept}" in output
    kept.write_text("[mpc]\nhorizon = 20\n")
    _, output, _ = run("inspect", made)
    assert f"inspect and train with --set {kept}" in output
    assert ">" not in output
