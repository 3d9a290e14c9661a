"""`stillwake dataset`: a user's own files, from the command line; one line and status 1 for what is wrong."""

import tomllib
from dataclasses import astuple, replace
from pathlib import Path

import h5py
import pytest
import xarray

from contract.config.loading import load_config
from contract.recording import dataset
from contract.recording.findings import findings
from stillwake.commands.dataset.inspecting import _draw, _needs_settings, episodes_table
from tests import foreign_plant
from tests.contract.recording.test_findings import data, wave
from tests.foreign_plant import LIMIT, NAMES, PERIOD

FACTS = ("--set", f"flow.control_period={PERIOD}", "--set", f"flow.action_limit={LIMIT}")


@pytest.fixture
def run(cli):
    """Call `stillwake dataset ...`: status, output and errors."""
    return lambda *words: astuple(cli("dataset", *words))


def written(folder, *, factor: float = 1.0) -> list[object]:
    """The words that import three files of three kinds, whose pressures are multiplied by a factor."""
    words: list[object] = ["--layout", foreign_plant.write_sensors(folder / "sensors.csv"), "--asymmetric"]
    for role, name, write, values in (
        ("train", "sweep.csv", foreign_plant.write_csv, foreign_plant.series(300, 1)),
        ("train", "calm.npz", foreign_plant.write_npz, foreign_plant.series(200, 2, forced=False)),
        ("test", "held out.h5", foreign_plant.write_hdf5, foreign_plant.series(150, 3)),
    ):
        words.append(f"{role}={write(folder / name, values | {'Cp': factor * values['Cp']})}")
    return [*words, *FACTS]


@pytest.fixture
def files(tmp_path):
    return written(tmp_path)


@pytest.fixture
def made(run, files, tmp_path):
    status, _, errors = run("import", tmp_path / "my.h5", *files)
    assert (status, errors) == (0, "")
    return tmp_path / "my.h5"


@pytest.mark.slow  # draws
def test_an_imported_data_set_is_shown_is_fit_and_its_settings_fit_it(run, made, tmp_path):
    read = dataset.read(made)
    found = [(item.name, item.role, len(item)) for item in read.episodes]
    assert found == [("sweep", "train", 300), ("calm", "train", 200), ("held out", "test", 150)]
    assert read.layout.names == NAMES
    status, output, _ = run("inspect", made, "--picture", tmp_path / "a.png")
    assert (status, (tmp_path / "a.png").read_bytes()[:4]) == (0, b"\x89PNG")
    # Not one of matplotlib's formulas.
    named = replace(read.episodes[0], name="from $3 V_$5 V")
    _draw(replace(read, episodes=(named,)), tmp_path / "b.png")
    facts = ("sweep", "held out", "lid-left", "control period 0.3", "reynolds not known", "without mirror images")
    assert [word for word in (*facts, "fit for training and export") if word not in output] == []
    # The hint has a redirection, which must not replace a file of the user.
    kept = made.with_suffix(".toml")
    assert f"--settings > {kept}" in output
    assert "inspect 'a b.h5' --settings > 'a b.toml'`" in _needs_settings(Path("a b.h5"))
    kept.write_text("[mpc]\nhorizon = 20\n")
    output = run("inspect", made)[1]
    assert f"inspect and train with --set {kept}" in output and ">" not in output
    assert "must end in .png" in run("inspect", made, "--picture", tmp_path / "a.jpg")[2]
    status, output, _ = run("inspect", made, "--settings")
    (tmp_path / "my.toml").write_text(output)
    assert tomllib.loads(output)["flow"] == {"control_period": PERIOD, "action_limit": LIMIT}
    config = load_config(tmp_path / "my.toml", [])
    assert [item.text for item in findings(read, config) if item.stops] == []
    calm = read.episodes[1].series["Cd"]
    assert config.mpc.drag_reference == pytest.approx(calm.mean(), rel=1e-5)


def test_figures_of_a_wave_are_in_the_table():
    """Of 0.1 sin and 0.5 + 2 cos over 20 steps of 0.25 t_c."""
    (cells,) = zip(*(column.cells for column in episodes_table(data(wave("w", 400, 20.0, 0.1))).columns), strict=True)
    assert cells == ("w", "train", "400", "99.8", "0.0707", "1.2500", "1.4142", "0.200")


def test_each_episode_becomes_netcdf_by_report(cli, made, tmp_path):
    assert cli("report", made, "--output", tmp_path / "my.nc").code == 0
    for episode in dataset.read(made).episodes:
        with xarray.open_dataset(tmp_path / f"my_{episode.name}.nc", engine="scipy") as found:
            assert (found.attrs["title"], found.attrs["role"]) == (episode.name, episode.role)
    with h5py.File(made, "a") as file:
        del file["episodes/sweep"], file["episodes/calm"]
    assert cli("report", made, "--output", tmp_path / "one.nc").out == f"wrote {tmp_path / 'one.nc'}\n"
    assert "one.nc: exists already; give another name" in cli("report", made, "--output", tmp_path / "one.nc").err
    assert (tmp_path / "one.nc").read_bytes() == (tmp_path / "my_held out.nc").read_bytes()


def test_a_file_that_is_there_is_replaced_only_when_asked_and_a_source_never(cli, refused, made, files, tmp_path):
    call = ("dataset", "import")
    assert "--overwrite" in refused(*call, made, *files)
    assert cli(*call, made, *files, "--set", "flow.reynolds=90", "--overwrite").code == 0
    assert dataset.read(made).plant.reynolds == 90.0
    source = tmp_path / "held out.h5"
    line = f"error: {source} is one of the files to read; give another name\n"
    assert refused(*call, source, *files, "--overwrite") == line
    assert "none.h5: no such file" in refused(*call, tmp_path / "other.h5", *files, f"test={tmp_path / 'none.h5'}")


def test_numbers_that_cannot_be_are_noted_until_a_reference_says_what_they_are(run, tmp_path):
    """Pressures in Pa: `tests/contract/recording` has every slip, and every way to say it."""
    words, mean = written(tmp_path, factor=75.0), foreign_plant.series(300, 1)["Cp"].mean()
    for more, factor in (((), 75.0), (("--reference", "Cp=75Pa"), 1.0)):
        status, output, errors = run("import", tmp_path / "o.h5", *words, *more, "--overwrite")
        checked = run("inspect", tmp_path / "o.h5", *FACTS)
        assert (status, errors, checked[0], checked[2]) == (0, "", 0, "")
        for text in (output, checked[1]):
            assert ("for pressures in Pa" in " ".join(text.split())) == (factor > 1.0), text
        assert dataset.read(tmp_path / "o.h5").episodes[0].series["Cp"].mean() == pytest.approx(factor * mean, rel=1e-3)


def test_settings_that_do_not_agree_are_wrong_where_they_are_given(run, made):
    status, output, _ = run("inspect", made, "--set", "flow.control_period=0.2", "--set", "flow.action_limit=0.2")
    assert status == 1
    assert "control period is 0.3 in the data set, flow.control_period = 0.2" in output
    # What is damaged is reported with what does not fit.
    with h5py.File(made, "r+") as file:
        del file["episodes/calm"].attrs["provenance"]
        file["episodes/sweep/action"][7] = -0.4
    status, output, errors = run("inspect", made)
    assert (status, "2 problems to correct" in errors) == (1, True)
    assert "'provenance' is missing" in output and "action is -0.4 at step 7" in output
    status, output, errors = run("inspect", made, "--settings")
    assert (status, output, "'provenance' is missing" in errors) == (1, "", True)
