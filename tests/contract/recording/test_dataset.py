"""Data sets in HDF5: what is written is read, what does not fit is refused by name, and rounds are added."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from contract import sensors
from contract.errors import DatasetError
from contract.recording import dataset
from contract.recording.dataset import UNITS, Dataset, append, pack, read_to_append, unpack
from contract.recording.episode import PlantFacts
from contract.sensor_layout import SensorLayout
from tests.contract.recording.random_episodes import FACTS, episode

FINEST, COARSEST = 2.0**-15, 2.0**-8


@pytest.fixture
def written(tmp_path) -> Path:
    path = tmp_path / "data.h5"
    dataset.write(path, Dataset(episodes=(episode("b"), episode("a", steps=7, role="test"))))
    return path


def test_round_trip_keeps_order_and_all_but_half_a_quantum(tmp_path, written):
    original = Dataset(episodes=(episode("b"), episode("a", steps=7, role="test")))
    read = dataset.read(written)
    assert [item.name for item in read.episodes] == ["b", "a"]
    for before, after in zip(original.episodes, read.episodes, strict=True):
        for name in ("role", "initial_action", "provenance"):
            assert getattr(after, name) == getattr(before, name)
        for field in UNITS:
            error = np.abs(after.series[field] - before.series[field]).max()
            # 16 bits over +-4 for Cp and over +-1 for the rest, which these stay within; time and action are exact.
            assert error <= (0.0 if field in ("t", "action") else 2**-14 if field == "Cp" else 2**-16), field
            assert after.series[field].dtype == np.float64
    with h5py.File(written) as file:
        node = file["episodes/b/Cp"]
        assert node.dtype == np.int16, "other readers need the quantum alone"
        assert (node[:] * node.attrs["quantum"] == read.episodes[0].series["Cp"]).all()
    # Writing what was read changes nothing.
    dataset.write(tmp_path / "again.h5", dataset.read(written))
    assert (tmp_path / "again.h5").read_bytes() == written.read_bytes()
    # A series may also be floating-point, as other writers store it.
    with h5py.File(written, "r+") as file:
        stored("Cl", lambda values: np.linspace(0, 1, len(values), dtype=np.float32))(file)
    assert dataset.read(written).episodes[1].series["Cl"] == pytest.approx(np.linspace(0, 1, 7))
    assert [item.name for item in read.with_role("train")] == ["b"]
    with pytest.raises(DatasetError, match="'train'"):
        Dataset(episodes=read.with_role("test")).with_role("train")


def test_facts_and_actions_that_follow_from_an_episode():
    flow = {"reynolds": 500.0, "action_limit": 0.075, "substeps": 30}
    found = Dataset(episodes=(episode("a"), episode("b", provenance={"flow": flow}))).plant
    assert found == PlantFacts(control_period=0.2, action_limit=0.075, reynolds=500.0)
    one = episode(steps=5, initial_action=-0.5)
    assert one.previous_action.tolist() == [-0.5, *one.series["action"][:4]]


def test_a_survey_names_everything_that_is_wrong_at_once(written):
    with h5py.File(written, "r+") as file:
        for spoil in (NO_FIELD, NO_PROVENANCE, WRONG_UNITS, NAN_IN_THE_MIDDLE):
            spoil(file)
    rest, problems = dataset.survey(written)
    assert rest is not None and [item.name for item in rest.episodes] == ["b"]
    for field, problem in zip(("'Cl'", "'Uy_probe'", "'provenance'", "'action'"), problems, strict=True):
        assert problem.startswith("episode a: ") and field in problem


def test_episode_that_does_not_fit_is_refused_by_name():
    for build, culprit in (
        (lambda: Dataset(episodes=(episode(series={"Cp": np.zeros((12, 89))}),)), r"has shape \(12, 89\), must be"),
        (lambda: episode(series={"Cp": np.zeros(12)}), r"'Cp' has shape \(12,\), must be \(12, sensors\)"),
        (lambda: episode(series={"Cd": np.zeros(11)}), r"'Cd' has shape \(11,\), must be \(12,\)"),
        (lambda: episode(series={"t": np.float64(0)}), "'t' has shape"),
        (lambda: episode(steps=0), "'t' holds no control step"),
        (lambda: episode(series={"Cd": np.array([0.0, np.nan])}, steps=2), "'Cd'.*not finite, first at step 1"),
        (lambda: episode(role="validation"), "'role' is 'validation'"),  # type: ignore[arg-type]  # a role of no dataset
        (lambda: episode(initial_action=np.nan), "'initial_action'"),
        (lambda: episode(name="a/b"), "'name'"),
        (lambda: replace(episode(), series={}), "'t' is missing"),
        (lambda: Dataset(episodes=(episode("a"), episode("a", steps=3))), "episode a: two episodes have this name"),
    ):
        with pytest.raises(DatasetError, match=culprit):
            build()


Spoil = Callable[[h5py.File], object]


def deleted(place: str, attribute: str = "") -> Spoil:
    return lambda file: (file[place].attrs if attribute else file).pop(attribute or place)


def changed(place: str, **attributes: object) -> Spoil:
    return lambda file: file[place].attrs.update(attributes)


def virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout(shape=(7,), dtype="i2")
    layout[:] = h5py.VirtualSource(".", "episodes/a/Cd", shape=(7,))
    del file["episodes/a/Cd"]
    file.create_virtual_dataset("episodes/a/Cd", layout)


def stored(name: str, change: Callable[[Any], Any]) -> Spoil:
    """A series of episode a in other form, with its attributes."""

    def spoil(file: h5py.File) -> None:
        node = file["episodes/a"]
        values, attributes = node[name][:], dict(node[name].attrs)
        del node[name]
        node.create_dataset(name, data=change(values)).attrs.update(attributes)

    return spoil


NO_FIELD, NO_PROVENANCE = deleted("episodes/a/Cl"), deleted("episodes/a", "provenance")
WRONG_UNITS = changed("episodes/a/Uy_probe", units="m/s")
NAN_IN_THE_MIDDLE = stored("action", lambda values: np.where(np.arange(7) == 3, np.nan, values))
SPOILT: list[tuple[Spoil, str]] = [
    (changed("/", schema="stillwake-dataset/4"), "schema 'stillwake-dataset/4'; this version reads"),
    (lambda file: file["episodes"].clear(), "no episode"),
    (deleted("episodes"), "damaged"),
    (NO_FIELD, "episode a: field 'Cl' is missing"),
    (NO_PROVENANCE, "episode a: attribute 'provenance' is missing: a JSON object"),
    (deleted("layout/positions"), "'layout/positions' is missing"),
    (changed("/", control_period=-0.2), "control_period = -0.2: must be positive"),
    (WRONG_UNITS, "field 'Uy_probe' is in 'm/s', must be in 'U_inf'"),
    (stored("Cp", lambda values: values[:, :4]), r"field 'Cp' has shape \(7, 4\), must be \(7, 90\)"),
    (NAN_IN_THE_MIDDLE, "episode a: field 'action' .* step 3"),
    (changed("episodes/a/Cd", quantum=-0.1), "field 'Cd' is stored as int16 with quantum -0.1"),
    (stored("Cd", lambda values: values.astype(np.int64)), "episode a: field 'Cd' is stored as int64"),
    # Read by h5py, a virtual array of itself is a segmentation fault.
    (virtual, "episodes/a/Cd is virtual or in another file: copy its numbers"),
    (lambda file: file.create_dataset("x", (8,), "u1", external=[("/etc/passwd", 0, 8)]), "x is virtual or in another"),
    (lambda file: file.create_dataset("x", (10**9,), "f8"), "holds 1000.* values or more: must be at most 134217728"),
    (lambda file: file.create_dataset("x", (1,), "u1", maxshape=(None,), chunks=(2**28,)), "values or more"),
    (lambda file: file.create_group(b"\xff\xfe"), "is not printable text"),
]


def test_spoilt_file_is_refused_by_name(written):
    sound = written.read_bytes()
    for spoil, culprit in SPOILT:
        written.write_bytes(sound)
        with h5py.File(written, "r+") as file:
            spoil(file)
        with pytest.raises(DatasetError, match=culprit) as caught:
            dataset.read(written)
        assert str(caught.value).startswith(f"{written}: ")
    for size in (0, 100, len(sound) - 1):
        written.write_bytes(sound[:size])
        with pytest.raises(DatasetError, match=r"data\.h5: is damaged"):
            dataset.read(written)
    written.unlink()
    for path in (written, written.parent):
        with pytest.raises(DatasetError, match=f"{path}: no such dataset"):
            dataset.read(path)
    # A value beyond 16 bits is refused, and nothing is written.
    with pytest.raises(DatasetError, match=r"episode first: field 'Cl' holds 129, more than 127\.996"):
        dataset.write(written, Dataset(episodes=(episode(series={"Cl": np.full(12, -129.0)}),)))
    assert not list(written.parent.iterdir())


@given(
    values=arrays(
        np.float64, array_shapes(max_dims=2, max_side=20), elements=st.floats(-32767 * COARSEST, 32767 * COARSEST)
    ),
    shrink=st.floats(1e-6, 1.0),
)
@example(values=np.array([32767.5 * FINEST, -32767.5 * FINEST]), shrink=1.0)
@example(values=np.array([32767.49 * FINEST]), shrink=1.0)
@example(values=np.zeros((0, 3)), shrink=1.0)
def test_every_value_comes_back_within_half_a_quantum(values, shrink):
    values = values * shrink
    integers, quantum = pack(values, FINEST, COARSEST)
    assert integers.dtype == np.int16 and integers.shape == values.shape
    assert (np.abs(unpack(integers, quantum) - values) <= quantum / 2).all()
    # The quantum is the finest that holds the series.
    peak = np.abs(values).max(initial=0.0)
    assert quantum == FINEST or peak > 32767 * quantum / 2
    again, same = pack(unpack(integers, quantum), FINEST, COARSEST)
    assert same == quantum and (again == integers).all()


def test_episodes_come_last_and_the_old_ones_keep_every_bit(written):
    with h5py.File(written) as file:
        before = {(n, f): node[f][:] for n, node in file["episodes"].items() for f in UNITS}
    append(written, [episode("z", role="controlled"), episode("c")], FACTS)
    with h5py.File(written) as file:
        assert all(np.array_equal(file["episodes"][n][f][:], values) for (n, f), values in before.items())
    found = dataset.read(written).episodes
    assert [item.name for item in found] == ["b", "a", "z", "c"]
    assert [item.role for item in found] == ["train", "test", "controlled", "train"]
    # A file of the second schema, without the layout, gets the present one; a data set that is not there is made.
    with h5py.File(written, "r+") as file:
        file.attrs["schema"] = dataset.DATASET_SCHEMA_2
        file.attrs["sensors"] = json.dumps(sensors.NAMES)
        del file["layout"]
    assert dataset.read(written).layout is sensors.TRUCK
    spoilt = shutil.copy(written, written.with_name("few.h5"))
    with h5py.File(spoilt, "r+") as file:
        file.attrs["sensors"] = json.dumps(["base_0"])
    with pytest.raises(DatasetError, match="sensors or their order differ"):
        dataset.read(spoilt)
    append(written, [episode("d")], FACTS)
    with h5py.File(written) as file:
        assert file.attrs["schema"] == dataset.DATASET_SCHEMA
    new = written.with_name("new.h5")
    assert read_to_append(new, FACTS).episodes == ()
    append(new, [episode("c")], FACTS)
    assert [len(dataset.read(path).episodes) for path in (written, new)] == [5, 1]


def test_another_flow_or_other_sensors_are_refused_by_what_differs(written):
    before = written.read_bytes()
    for facts, named in (
        ({**FACTS, "flow": {"reynolds": 400.0, "substeps": 30}}, r"flow\.reynolds = 500\.0; .* have 400\.0"),
        ({**FACTS, "grid": [310, 114]}, r"grid = \[443, 164\]; .* have \[310, 114\]"),
    ):
        with pytest.raises(DatasetError, match=rf"data\.h5: episode b was recorded with {named}"):
            append(written, [episode("c")], facts)
        assert written.read_bytes() == before
    renamed = SensorLayout.of(("a", "b"), np.eye(2), symmetric=False)
    with pytest.raises(DatasetError, match=r"in names: upper_00, .*\(90 in all\), and a, b$"):
        read_to_append(written, FACTS, renamed)
