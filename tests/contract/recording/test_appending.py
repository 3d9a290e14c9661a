import json

import h5py
import numpy as np
import pytest

from contract import sensors
from contract.errors import DatasetError
from contract.recording import dataset
from contract.recording.appending import append, read_to_append
from contract.recording.dataset import UNITS
from contract.sensor_layout import SensorLayout
from tests.contract.recording.random_episodes import FACTS, episode


def test_episodes_come_last_and_the_old_ones_keep_every_bit(written):
    with h5py.File(written) as file:
        before = {(n, f): node[f][:] for n, node in file["episodes"].items() for f in UNITS}
    append(written, [episode("z", role="controlled"), episode("c")], FACTS)
    with h5py.File(written) as file:
        assert all(np.array_equal(file["episodes"][n][f][:], values) for (n, f), values in before.items())
    found = dataset.read(written).episodes
    assert [item.name for item in found] == ["b", "a", "z", "c"]
    assert [item.role for item in found] == ["train", "test", "controlled", "train"]


def test_a_data_set_is_made_or_added_to(written, tmp_path):
    with h5py.File(written, "r+") as file:
        file.attrs["schema"] = dataset.SCHEMA_2
        file.attrs["sensors"] = json.dumps(sensors.NAMES)
        del file["layout"]
    append(written, [episode("c")], FACTS)
    assert dataset.schema_of(written) == dataset.SCHEMA
    assert [item.name for item in dataset.read(written).episodes] == ["b", "a", "c"]
    # A data set that is not there is made.
    assert read_to_append(tmp_path / "new.h5", FACTS) == ()
    append(tmp_path / "new.h5", [episode("c")], FACTS)
    assert [item.name for item in dataset.read(tmp_path / "new.h5").episodes] == ["c"]


def test_another_flow_or_other_sensors_are_refused_by_what_differs(written):
    for facts, named in (
        ({**FACTS, "flow": {"reynolds": 400.0, "substeps": 30}}, r"flow\.reynolds = 500\.0, .* has 400\.0"),
        ({**FACTS, "grid": [310, 114]}, r"grid = \[443, 164\], .* has \[310, 114\]"),
    ):
        before = written.read_bytes()
        with pytest.raises(DatasetError, match=rf"data\.h5: episode b was recorded with {named}"):
            append(written, [episode("c")], facts)
        assert written.read_bytes() == before
    renamed = SensorLayout.of(("a", "b"), np.eye(2), symmetric=False)
    with pytest.raises(DatasetError, match=r"in names: upper_00, .*\(90 in all\), and a, b$"):
        read_to_append(written, FACTS, renamed)
