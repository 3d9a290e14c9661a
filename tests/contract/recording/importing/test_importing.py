"""Files of a user's own become a data set, whole and exact, or are refused by file and place."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contract.errors import DatasetError
from contract.recording import dataset
from contract.recording.dataset import CP_QUANTUM, QUANTUM, REQUIRED, Dataset
from contract.recording.facts import PlantFacts
from contract.recording.importing.assemble import Source, assemble
from contract.recording.importing.sensor_table import read_sensors
from contract.sensor_layout import SensorLayout
from tests import foreign_plant
from tests.foreign_plant import BASE, LIMIT, NAMES, PERIOD, POSITIONS, WRITERS

FACTS = PlantFacts(control_period=PERIOD, action_limit=LIMIT)


@pytest.fixture
def layout(tmp_path) -> SensorLayout:
    return read_sensors(foreign_plant.write_sensors(tmp_path / "sensors.csv"), symmetric=False)


def imported(path: Path, layout: SensorLayout, **more: Any) -> Dataset:
    return assemble([Source(path=path, role="train")], layout, FACTS, **more)


def test_every_format_gives_the_same_data_set_within_half_a_quantum(tmp_path, layout):
    for suffix in WRITERS:
        values = foreign_plant.series(60, 1)
        made = imported(WRITERS[suffix](tmp_path / f"run 1{suffix}", values), layout)
        dataset.write(tmp_path / "out.h5", made)
        read = dataset.read(tmp_path / "out.h5")
        (episode,) = read.episodes
        assert (episode.name, episode.role, episode.initial_action) == ("run 1", "train", 0.0)
        assert read.plant == FACTS
        assert read.layout.difference(layout) is None
        for name in REQUIRED:
            # Cd and Cl stay within +-2, so their quantum is the next power of two above the finest.
            half = {"t": 0.0, "action": 0.0, "Cp": CP_QUANTUM / 2}.get(name, QUANTUM)
            assert np.abs(episode.series[name] - values[name]).max() <= half, name


def test_other_units_names_and_series_are_taken_where_they_are(tmp_path, layout):
    values = foreign_plant.series(30, 2)
    renamed = {"drag": values["Cd"], "p": values["Cp"] * 375.0} | {k: values[k] for k in ("action", "Cl")}
    path = foreign_plant.write_npz(tmp_path / "a.npz", renamed)
    made = imported(path, layout, renamed={"Cd": "drag", "Cp": "p"}, dynamic_pressure=375.0)
    np.testing.assert_allclose(made.episodes[0].series["Cp"], values["Cp"], rtol=1e-12)
    np.testing.assert_array_equal(made.episodes[0].series["Cd"], values["Cd"])
    # The action before the first row and the ledger are taken where they are.
    values = foreign_plant.series(30, 2) | {"jet_power": np.linspace(0, 1, 30), "initial_action": np.array(0.07)}
    episode = imported(foreign_plant.write_npz(tmp_path / "a.npz", values), layout).episodes[0]
    assert episode.initial_action == 0.07
    assert episode.previous_action[:2].tolist() == [0.07, values["action"][0]]
    assert "jet_power" in episode.series


def test_the_layout_is_the_file_s_with_mirror_images_by_the_places(layout, tmp_path):
    assert layout.names == NAMES and layout.mirror is None
    np.testing.assert_array_equal(layout.positions, POSITIONS)
    assert tuple(layout.names[column] for column in layout.base) == BASE
    (tmp_path / "s.csv").write_text("name;x;y\nup;1.0;0.5\ndown;1.0;-0.5\nnose;0.0;0.0\n")
    mirror = read_sensors(tmp_path / "s.csv", symmetric=True).mirror
    assert mirror is not None and mirror.tolist() == [1, 0, 2]


HEADER = f"action,Cd,Cl,{','.join(NAMES)}"


ROW = "0.1,1,0,1,2,3,4,5,6,7"
T = PERIOD * np.arange(20)


def test_a_file_that_does_not_fit_is_refused_by_name_and_place(tmp_path, layout):
    cases: list[tuple[str, str | bytes | dict[str, Any], str]] = [
        ("a.xlsx", "", r"a\.xlsx: a data file must end in \.csv"),
        ("a.h5", "text", r"a\.h5: damaged or not an HDF5"),
        ("a.csv", b"\xff\xfe\x00", r"a\.csv: is not a text file in UTF-8"),
        ("a.csv", "1,2\n3,4\n", r"a\.csv: line 1 holds numbers; the first line must have the names"),
        ("a.csv", "action;Cd\n0,5;1\n", r"line 2, column 'action': '0,5' is not a number: write 0\.5, with a"),
        (
            "a.csv",
            f"{HEADER}\n{ROW.replace('1,0', '1,')}",
            r"line 2, column 'Cl': '' is not a number; fill the gap",
        ),
        ("a.csv", f"{HEADER}\n{ROW}\n{ROW[:-2]}", r"a\.csv: line 3: 9 values, the header has 10 columns"),
        ("a.csv", f"{HEADER}\n{ROW.replace('1,0', '1,nan')}", r"a\.csv: line 2, column 'Cl': nan is not finite"),
        ("a.csv", f"{HEADER.replace('Cl', 'Cd')}\n{ROW}", r"a\.csv: line 1: column 'Cd' is there twice"),
        ("a.csv", f"{HEADER.replace('Cl', 'lift')}\n{ROW}", r"a\.csv: no column 'Cl'; .* use --map Cl=NAME"),
        ("a.npz", {"action": np.array(["a"] * 20)}, r"a\.npz: array 'action' holds .*, must hold numbers"),
        ("a.npz", {"initial_action": np.zeros(5)}, r"'initial_action' has shape \(5,\), must be one number"),
        ("a.npz", {"Cd": np.zeros(19)}, r"'Cd' has shape \(19,\), must be \(20,\)"),
        ("a.npz", {"Cp": np.zeros((7, 20))}, r"'Cp' has shape \(7, 20\), must be \(20, 7\) .*transpose it"),
        ("a.npz", {"Cp": 500.0 * np.ones((20, 7))}, "'Cp' reaches 500, .* if it is in Pa, use --dynamic-pressure"),
        ("a.npz", {"action": np.linspace(0, 0.4, 20)}, r"action is 0\.4 at step 19, beyond the limit of 0\.2"),
        ("a.npz", {"t": T / 10}, "t rises by 0.03, the control period is 0.3: 10 samples a period. Keep one row of 10"),
        ("a.npz", {"t": T[::-1]}, "t does not rise from step 0 to 1"),
        ("a.npz", {"t": np.where(T > 3, T + 0.2, T)}, "t rises by 0.5 from step 10 to 11"),
    ]
    for name, content, message in cases:
        if isinstance(content, dict):
            foreign_plant.write_npz(tmp_path / name, foreign_plant.series(20, 3) | content)
        else:
            (tmp_path / name).write_bytes(content.encode() if isinstance(content, str) else content)
        with pytest.raises(DatasetError, match=message) as caught:
            imported(tmp_path / name, layout)
        assert "\n" not in str(caught.value)
    with pytest.raises(DatasetError, match=r"none\.csv: no such file"):
        imported(tmp_path / "none.csv", layout)


def test_comments_and_a_header_that_is_one_are_read(tmp_path, layout):
    """numpy.savetxt writes the header after a #; others write remarks above it, a byte order mark, or spaces."""
    for head in ("# {}\n", "# my rig, 2026\n\n{}\n", "\ufeff{}\r\n"):
        values = foreign_plant.series(20, 3)
        path = foreign_plant.write_csv(tmp_path / "a.csv", values)
        names, rows = path.read_text().split("\n", 1)
        path.write_text(head.format(names) + rows, encoding="utf-8")
        series = imported(path, layout).episodes[0].series
        np.testing.assert_allclose(series["t"], values["t"], atol=1e-6)
        np.testing.assert_allclose(series["Cp"], values["Cp"], atol=1e-6)


def test_what_is_not_used_is_told_and_a_renamed_column_must_be_there(tmp_path, layout):
    """A clock called "time" would otherwise be passed over in silence, and with it a wrong period."""
    values = foreign_plant.series(20, 3)
    path = foreign_plant.write_npz(tmp_path / "a.npz", values | {"time": np.linspace(0.0, 0.019, 20)})
    told: list[tuple[str, tuple[str, ...]]] = []
    imported(path, layout, unread=lambda path, names: told.append((path.name, names)))
    assert told == [("a.npz", ("time",))]
    with pytest.raises(DatasetError, match=r"t rises by 0\.001"):
        imported(path, layout, renamed={"t": "time"})
    with pytest.raises(DatasetError, match=r"--map t=zeit: no file has a column 'zeit'"):
        imported(path, layout, renamed={"t": "zeit"})
    # One of two files has the other name; where a file has neither, it is refused.
    drag = {"drag" if name == "Cd" else name: array for name, array in values.items()}
    other = foreign_plant.write_npz(tmp_path / "b.npz", drag)
    both = [Source(path=path, role="train"), Source(path=other, role="test")]
    first, second = assemble(both, layout, FACTS, renamed={"Cd": "drag"}).episodes
    np.testing.assert_array_equal(first.series["Cd"], second.series["Cd"])


def test_wrong_arguments_and_sensors_are_refused(tmp_path, layout):
    one = Source(path=foreign_plant.write_npz(tmp_path / "a.npz", foreign_plant.series(20, 3)), role="train")
    two = Source(path=tmp_path / "a.csv", role="test")
    for sources, more, message in (
        ([], {}, "no data file is given"),
        ([one, two], {}, "two files would make an episode called 'a'"),
        ([one], {"renamed": {"drag": "Cd"}}, "--map drag=Cd: 'drag' is no series and no sensor"),
        ([one], {"dynamic_pressure": 0.0}, "dynamic pressure 0.0: must be positive"),
    ):
        with pytest.raises(DatasetError, match=message):
            assemble(sources, layout, FACTS, **more)
    with pytest.raises(DatasetError, match="must be given"):
        assemble([one], layout, PlantFacts(control_period=PERIOD))
    # Sensors that do not fit are refused.
    for text, message in (
        ("a,1,1\nb,1,-1\n", "'1' is there twice; the first line must have the names"),
        ("name,x,y\na,1,0\na,2,0\n", "sensor 'a': named twice"),
        ("name,x,y\na,1,left\n", "line 2, column 'y': 'left' is not a number"),
        ("name,x,y\na,1,0\nCd,1,0\n", "line 3: a sensor cannot be called 'Cd'"),
    ):
        (tmp_path / "s.csv").write_text(text)
        with pytest.raises(DatasetError, match=message) as caught:
            read_sensors(tmp_path / "s.csv", symmetric=True)
        assert "s.csv" in str(caught.value)
