"""A writer of episodes as netCDF files with the conventions of CF, for xarray, ParaView, MATLAB, R and others."""

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from contract.atomic import replacing
from contract.recording.dataset import packed
from contract.recording.episode import UNITS, Episode
from contract.sensor_layout import SensorLayout

FILL: Final = np.int16(-32768)
"""Value that marks a missing integer. A series may have netCDF's default fill value, -32767, but not this value."""
LONG_NAMES: Final = {
    "t": "time", "action": "flow rate of the jets", "Cp": "pressure coefficient", "Cd": "drag coefficient",
    "Cl": "side force coefficient", "Cd_slot_pressure": "drag of the slots by pressure",
    "Cd_slot_viscous": "drag of the slots by viscous stress", "Cd_momentum": "drag by the momentum of the jets",
    "jet_power": "power of the jets", "Uy_probe": "transverse velocity behind the base",
}  # fmt: skip


def write_netcdf(path: Path, episode: Episode, layout: SensorLayout) -> None:
    """Write an episode as classic netCDF, completely or not at all. The dimensions are `t` and `sensor`; `sensor_name`,
    `x` and `y` are coordinates of the sensors. All numbers are dimensionless, as CF's unit "1" states; `long_name`
    states the reference quantity. Measured series are the 16-bit integers of a data set, with `scale_factor`.
    `dataset import` reads the file. Raises DatasetError as `dataset.write` does."""
    from scipy.io import netcdf_file

    with replacing(path) as temporary, netcdf_file(temporary, "w") as file:
        file.Conventions, file.title, file.role = "CF-1.11", episode.name.encode(), episode.role
        file.provenance = json.dumps(episode.provenance, sort_keys=True)
        names = np.array([name.encode() for name in layout.names])
        names = np.char.ljust(names, names.itemsize).view("S1").reshape(len(names), -1)
        for dimension, size in (("t", len(episode)), ("sensor", len(layout)), ("name_length", names.shape[1])):
            file.createDimension(dimension, size)

        def put(name: str, values: npt.NDArray[Any], *dimensions: str, **attributes: Any) -> None:
            variable = file.createVariable(name, values.dtype, dimensions)
            variable[...] = values
            for attribute, value in attributes.items():
                setattr(variable, attribute, value)

        put("sensor_name", names, "sensor", "name_length", long_name="name of the sensor", _Encoding="utf-8")
        for axis, values in zip("xy", layout.positions.T, strict=True):
            put(axis, values, "sensor", units="1", long_name=f"position of the sensor along {axis} in W")
        put("initial_action", np.array(episode.initial_action), units="1", long_name="action before the first row")
        for name, unit in UNITS.items():
            if name in episode.series:
                series, quantum = packed(episode, name)
                reference = "" if unit == "1" else f" in {unit}"
                facts: dict[str, Any] = {"coordinates": "sensor_name x y"} if name == "Cp" else {}
                facts |= {"units": "1", "long_name": f"{LONG_NAMES[name]}{reference}"}
                facts |= {"axis": "T"} if name == "t" else {}
                facts |= {} if quantum is None else {"scale_factor": quantum, "_FillValue": FILL}
                put(name, series, *("t", "sensor")[: series.ndim], **facts)
