"""An episode as netCDF is read by others as it is, and by the import to the bit."""

import numpy as np
import pytest
import xarray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkIONetCDF import vtkNetCDFCFReader

from contract.recording import dataset
from contract.recording.dataset import Dataset
from contract.recording.episode import PlantFacts
from contract.recording.importing.assemble import EpisodeSource, assemble
from contract.recording.netcdf import write_netcdf
from contract.sensors import TRUCK
from tests.contract.recording.random_episodes import episode


@pytest.fixture
def written(tmp_path):
    series = {"Cl": np.array([-1.0, -32767 / 32768, 0.5] * 4)}
    dataset.write(tmp_path / "a.h5", Dataset(episodes=(episode("Lauf für Ø", series=series),)))
    (stored,) = dataset.read(tmp_path / "a.h5").episodes
    write_netcdf(tmp_path / "a.nc", stored, TRUCK)
    return stored, tmp_path / "a.nc"


def test_xarray_reads_series_units_and_sensors_and_the_import_the_same_episode(written):
    stored, path = written
    facts = PlantFacts(control_period=0.2, action_limit=10.0)
    (imported,) = assemble([EpisodeSource(path=path, role="train")], TRUCK, facts).episodes
    assert (imported.initial_action, imported.series.keys()) == (stored.initial_action, stored.series.keys())
    with xarray.open_dataset(path, engine="scipy") as found:
        assert [found.attrs[name] for name in ("Conventions", "title", "role")] == ["CF-1.11", stored.name, "train"]
        assert dict(found.sizes) == {"t": 12, "sensor": 90}
        for name, values in stored.series.items():
            np.testing.assert_array_equal(found[name], values, err_msg=name)
            np.testing.assert_array_equal(imported.series[name], values, err_msg=name)
            assert found[name].attrs["units"] == "1" and found[name].attrs["long_name"]
        assert found["Cp"].dims == ("t", "sensor") and found["Cp"].encoding["dtype"] == np.int16
        assert found["jet_power"].attrs["long_name"] == "power of the jets in rho U_inf^3 W / 2"
        assert [name.strip() for name in found["sensor_name"].values] == list(TRUCK.names)
        np.testing.assert_array_equal(np.column_stack([found["x"], found["y"]]), TRUCK.positions)
        assert float(found["initial_action"]) == stored.initial_action


def test_the_reader_of_paraview_has_the_series_over_time(written):
    stored, path = written
    reader = vtkNetCDFCFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    steps = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    np.testing.assert_array_equal(steps, stored.series["t"])
    reader.SetDimensions("(sensor)")
    for step in (0, 7):
        reader.UpdateTimeStep(stored.series["t"][step])
        found = vtk_to_numpy(reader.GetOutput().GetPointData().GetArray("Cp"))
        np.testing.assert_array_equal(found, stored.series["Cp"][step])
