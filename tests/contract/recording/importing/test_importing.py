"""Files of a user's own become a data set, whole and exact, or are refused by file and place."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import netcdf_file, savemat

from contract.errors import ConfigError, DatasetError
from contract.recording import dataset
from contract.recording.dataset import CP_QUANTUM, QUANTUM, Dataset
from contract.recording.episode import REQUIRED, PlantFacts
from contract.recording.importing.assemble import EpisodeSource, assemble
from contract.recording.importing.csv_table import read_sensors
from contract.recording.importing.source_file import references_of
from contract.sensor_layout import SensorLayout
from tests import foreign_plant
from tests.foreign_plant import BASE, LIMIT, NAMES, PERIOD, POSITIONS, WRITERS

HEADER = f"action,Cd,Cl,{','.join(NAMES)}"
ROW = "0.1,1,0,1,2,3,4,5,6,7"
T = PERIOD * np.arange(20)
FACTS = PlantFacts(control_period=PERIOD, action_limit=LIMIT)


@pytest.fixture
def layout(tmp_path) -> SensorLayout:
    return read_sensors(foreign_plant.write_sensors(tmp_path / "sensors.csv"), symmetric=False)


def imported(path: Path, layout: SensorLayout, **more: Any) -> Dataset:
    return assemble([EpisodeSource(path=path, role="train")], layout, FACTS, **more)


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


def test_the_layout_is_the_file_s_with_mirror_images_by_the_places(layout, tmp_path):
    assert layout.names == NAMES and layout.mirror is None
    np.testing.assert_array_equal(layout.positions, POSITIONS)
    assert tuple(layout.names[column] for column in layout.base) == BASE
    (tmp_path / "s.csv").write_text("name;x;y\nup;1.0;0.5\ndown;1.0;-0.5\nnose;0.0;0.0\n")
    mirror = read_sensors(tmp_path / "s.csv", symmetric=True).mirror
    assert mirror is not None and mirror.tolist() == [1, 0, 2]


def test_a_file_that_does_not_fit_is_refused_by_name_and_place(tmp_path, layout):
    cases: list[tuple[str, str | bytes | dict[str, Any], str]] = [
        ("a.xlsx", "", r"a\.xlsx: a data file must end in \.csv"),
        ("a.mat", "text", r"a\.mat: is damaged or not a MATLAB file"),
        ("a.nc", b"CDF\x01 text", r"a\.nc: is damaged or not a netCDF file"),
        ("a.h5", "text", r"a\.h5: is damaged or not an HDF5"),
        ("a.csv", b"\xff\xfe\x00", r"a\.csv: is not a text file in UTF-8"),
        ("a.csv", "1,2\n3,4\n", r"a\.csv: line 1 holds numbers; the first line must have the names"),
        ("a.csv", "action;Cd\n0,5;1\n", r"line 2, column 'action': '0,5' is not a number: write 0\.5, with a"),
        ("a.csv", f"{HEADER}\n{ROW.replace('1,0', '1,')}", r"line 2, column 'Cl': '' is not a number; fill the gap"),
        ("a.csv", f"{HEADER}\n{ROW}\n{ROW[:-2]}", r"a\.csv: line 3 has 9 values, but the header has 10 columns"),
        ("a.csv", f"{HEADER}\n{ROW.replace('1,0', '1,nan')}", r"a\.csv: line 2, column 'Cl': nan is not finite"),
        ("a.csv", f"{HEADER.replace('Cl', 'Cd')}\n{ROW}", r"a\.csv: line 1: column 'Cd' occurs twice"),
        ("a.csv", f"{HEADER.replace('Cl', 'lift')}\n{ROW}", r"a\.csv: no column 'Cl'; .* use --map Cl=NAME"),
        ("a.npz", {"action": np.array(["a"] * 20)}, r"a\.npz: array 'action' holds .*, must hold numbers"),
        ("a.npz", {"initial_action": np.zeros(5)}, r"'initial_action' has shape \(5,\), must be one number"),
        ("a.npz", {"Cd": np.zeros(19)}, r"'Cd' has shape \(19,\), must be \(20,\)"),
        ("a.npz", {"Cp": np.zeros((7, 20))}, r"'Cp' has shape \(7, 20\), must be \(20, 7\).*transpose it"),
        ("a.npz", {"Cp": 500.0 * np.ones((20, 7))}, "'Cp' reaches 500; .* if it is in Pa, give .*--reference Cp=240Pa"),
        ("a.npz", {"Cd": np.where(T < 1, 1e9, 1.2)}, r"'Cd' reaches 1e\+09; .* step 0, may stand for a missing"),
        ("a.npz", {"Cd": np.full(20, 9.96921e36)}, r"'Cd' holds a value, 9\.96921e\+36, that is the default fill"),
        ("a.npz", {"Cl": np.array([{}] * 20)}, "'Cl' holds object, must hold numbers"),
        ("a.csv", f"{HEADER}\n{ROW.replace('1,0', '1,9.96921e36')}", "'Cl': 9.96921e36 is the default fill value"),
        ("a.csv", f"{HEADER},,\n{ROW}\n{ROW},9,9,9", r"line 3 has 13 values, but the header has 12 columns"),
        ("a.npz", {"action": np.linspace(0, 0.4, 20)}, r"action is 0\.4 at step 19, beyond flow.action_limit = 0\.2"),
        ("a.npz", {"initial_action": np.array(-0.3)}, r"action is -0\.3 before the first row, beyond"),
        ("a.npz", {"t": 5 * T}, r"t rises by 1\.5, must .* if t is in s or ms.* import with --reference t=5$"),
        ("a.npz", {"t": T / 10}, "t rises by 0.03, but the control period is 0.3: 10 samples per period. Keep one row"),
        ("a.npz", {"t": T[::-1]}, "t does not rise from step 0 to 1"),
        ("a.npz", {"t": T[np.arange(20) // 2]}, "t does not rise from step 0 to 1: 0, 0; some rows occur twice"),
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
    values = foreign_plant.series(20, 3) | {"Cp": np.full((20, 7), 101e3)}
    absolute = foreign_plant.write_npz(tmp_path / "a.npz", values)
    with pytest.raises(DatasetError, match=r"'Cp' reaches 269\.3.*; .*p - p_inf, not absolute"):
        imported(absolute, layout, references=references_of(["Cp=375Pa"]))
    with pytest.raises(DatasetError, match=r"none\.csv: no such file"):
        imported(tmp_path / "none.csv", layout)


def test_a_constant_sensor_is_read_whatever_its_value_and_a_series_too_fine_to_store_is_refused(tmp_path, layout):
    values = foreign_plant.series(300, 2)
    for value in (0.0, 99.99, -0.37):
        values["Cp"][:, 1] = value
        made = imported(foreign_plant.write_csv(tmp_path / "a.csv", values), layout)
        assert np.ptp(made.episodes[0].series["Cp"][:, 1]) == 0.0
    values["Cp"][:, 1] = 0.5 + 1e-6 * np.sin(np.arange(300))
    with pytest.raises(DatasetError, match=f"sensor {NAMES[1]} varies by .*correct --reference Cp"):
        imported(foreign_plant.write_csv(tmp_path / "a.csv", values), layout)


def test_what_is_not_used_is_told_and_a_renamed_column_must_be_there(tmp_path, layout):
    """A clock called "time" would otherwise be passed over in silence, and with it a wrong period."""
    values = foreign_plant.series(20, 3)
    path = foreign_plant.write_npz(tmp_path / "a.npz", values | {"time": np.linspace(0.0, 0.019, 20)})
    told: list[tuple[str, str]] = []
    imported(path, layout, told=lambda path, note: told.append((path.name, note)))
    assert told == [("a.npz", "not used: time")]
    # One array has all pressures, so a second array of a sensor has no effect.
    for name, renamed in ((NAMES[0], {}), ("mine", {NAMES[0]: "mine"})):
        path = foreign_plant.write_npz(tmp_path / "a.npz", values | {name: np.zeros(20), "time": values["t"]})
        imported(path, layout, renamed=renamed, told=lambda path, note: told.append((path.name, note)))
        assert told[-1] == ("a.npz", f"not used: {name}, time")
    foreign_plant.write_npz(path, values | {"time": np.linspace(0.0, 0.019, 20)})
    with pytest.raises(DatasetError, match=r"t rises by 0\.001"):
        imported(path, layout, renamed={"t": "time"})
    with pytest.raises(DatasetError, match=r"--map t=zeit: no file has a column 'zeit'"):
        imported(path, layout, renamed={"t": "zeit"})
    # One of two files has the other name; where a file has neither, it is refused.
    drag = {"drag" if name == "Cd" else name: array for name, array in values.items()}
    other = foreign_plant.write_npz(tmp_path / "b.npz", drag)
    both = [EpisodeSource(path=path, role="train"), EpisodeSource(path=other, role="test")]
    first, second = assemble(both, layout, FACTS, renamed={"Cd": "drag"}).episodes
    np.testing.assert_array_equal(first.series["Cd"], second.series["Cd"])


def packed(path: Path, values: dict[str, Any], attributes: dict[str, Any]) -> Path:
    with h5py.File(path, "w") as file:
        for name, array in values.items():
            file[name] = array
        file["Cd"].attrs.update(attributes)
    return path


def test_packed_numbers_gaps_and_units_are_those_of_cf(tmp_path, layout):
    values = foreign_plant.series(20, 3)
    drag = values["Cd"]
    stored = np.round((drag - 1.0) / 0.001).astype(np.int16)
    least, byte = stored.min(), (stored - 150).astype(np.uint8).view(np.int8)
    packing: dict[str, Any] = {"scale_factor": 0.001, "add_offset": 1.0}
    for numbers, attributes in (
        (stored, packing),
        (stored, {name: np.array([value]) for name, value in packing.items()} | {"units": b"1", "_FillValue": -32767}),
        (stored.astype(np.float32), packing | {"valid_range": np.array([-500.0, 900.0])}),
        (stored, packing | {"valid_min": np.int16(-500), "valid_max": np.float64(1.9)}),
        (byte, packing | {"add_offset": 1.15, "_Unsigned": "true", "_FillValue": np.int8(-1)}),
        (stored - least, packing | {"add_offset": 1 + 0.001 * least, "_FillValue": np.nan}),
        (100 * drag, {"units": "%"}),
        (drag, {"units": "", "_FillValue": np.nan, "missing_value": np.array([-99.0, 1e20])}),
        (drag, {"units": h5py.Empty("S1")}),
        (drag.astype(np.float16), {}),
    ):
        found = imported(packed(tmp_path / "a.h5", values | {"Cd": numbers}, attributes), layout).episodes[0]
        np.testing.assert_allclose(found.series["Cd"], drag, atol=0.0005001)
    for numbers, attributes, message in (
        (stored, packing | {"_FillValue": stored[7]}, r"a value, \d+, that is missing by its _FillValue, .* step 7 \("),
        (drag, {"missing_value": drag[[9, 4]]}, r"by its missing_value, first at step 4 \(2 of 20\); fill the gap"),
        (drag.astype(np.float32), {"_FillValue": np.float64(drag[3])}, "missing by its _FillValue, first at step 3"),
        (stored, packing | {"valid_max": np.int16(stored.max() - 1)}, "is outside its valid_max"),
        (stored, packing | {"valid_range": [0.0, 1.0]}, "is outside its valid_range, first at step 0"),
        (drag, {"scale_factor": "two"}, "its attribute scale_factor .* must be a number"),
        (drag, {"scale_factor": 0.0}, "its attribute scale_factor .* must be a number"),
        (drag, {"units": "N"}, "'Cd' is in 'N'; Cd must be without dimension: .* --reference Cd=40N"),
        (drag, {"units": "degC"}, "'Cd' is in 'degC'; Cd must be without dimension"),
    ):
        with pytest.raises(DatasetError, match=message):
            imported(packed(tmp_path / "a.h5", values | {"Cd": numbers}, attributes), layout)
    # Chunks of HDF5 that were never written, and a file of netCDF, read by SciPy's own unpacking.
    with h5py.File(packed(tmp_path / "a.h5", values, {}), "r+") as file:
        del file["Cl"]
        file.create_dataset("Cl", shape=(20,), dtype="f4", fillvalue=-99)[:10] = 0.0
    with pytest.raises(DatasetError, match=r"'Cl' .* missing by its _FillValue, first at step 10 \(10 of 20\)"):
        imported(tmp_path / "a.h5", layout)
    for gap in (False, True):
        with netcdf_file(tmp_path / "a.nc", "w", maskandscale=True) as file:
            file.createDimension("row", 20)
            file.createDimension("sensor", 7)
            for name, array in values.items():
                one = file.createVariable(name, "h" if name == "Cd" else "d", ("row", "sensor")[: array.ndim])
                if name == "Cd":
                    one.scale_factor, one.add_offset, one.missing_value = 0.001, 1.0, -32768
                one[:] = array
            if gap:  # with netCDF's own fill value, as SciPy has written another one
                del file.variables["Cd"]._attributes["_FillValue"]
                file.variables["Cd"].data[4] = -32767
        if not gap:
            found = imported(tmp_path / "a.nc", layout).episodes[0]
            np.testing.assert_allclose(found.series["Cd"], drag, atol=0.0005001)
    with pytest.raises(DatasetError, match="'Cd' holds a value, -32767, that is the default fill value of netCDF"):
        imported(tmp_path / "a.nc", layout)


def test_names_in_a_classic_netcdf_file_are_utf_8_or_as_scipy_writes_them(tmp_path, layout):
    values = foreign_plant.series(20, 3)
    pressures = dict(zip(NAMES, values.pop("Cp").T, strict=True))
    for encoding in ("utf-8", "latin-1"):
        with netcdf_file(tmp_path / "a.nc", "w") as file:
            file.createDimension("row", 20)
            for name, array in (values | pressures).items():
                file.createVariable(name.encode(encoding).decode("latin-1"), "d", ("row",))[:] = array
        series = imported(tmp_path / "a.nc", layout).episodes[0].series
        np.testing.assert_array_equal(series["Cp"], np.column_stack(list(pressures.values())))


def test_an_array_has_each_of_its_names_and_a_dimension_has_no_values(tmp_path, layout):
    values = foreign_plant.series(20, 3)
    time = values.pop("t")
    with h5py.File(packed(tmp_path / "a.nc", values, {}), "r+") as file:
        kept = file.create_dataset("t", shape=(20,), dtype=">f4")
        kept.attrs["NAME"] = np.bytes_(f"This is a netCDF dimension but not a netCDF variable{20:10d}")
    np.testing.assert_allclose(imported(tmp_path / "a.nc", layout).episodes[0].series["t"], time, atol=1e-12)
    for link in (h5py.SoftLink("/clock"), "clock"):
        with h5py.File(packed(tmp_path / "a.h5", values | {"clock": 1.5 * time}, {}), "r+") as file:
            file["lost"], file["loop"] = h5py.SoftLink("/none"), h5py.SoftLink("/loop")
            file["t"] = file[link] if isinstance(link, str) else link
        with pytest.raises(DatasetError, match="control period"):
            imported(tmp_path / "a.h5", layout)


def test_numbers_in_a_unit_are_divided_by_what_1_is_in_it(tmp_path, layout):
    """Pascals, milliseconds and newtons by the option, by an attribute, or in brackets behind a column's name."""
    values = foreign_plant.series(20, 3)
    rig = values | {"t": 5 * values["t"], "Cd": -40 * values["Cd"], "Cp": 0.375 * values["Cp"]}
    names = {"t": "t [ms]", "Cd": "Cd (N)", "Cl": "Cl []", **{name: f"{name} [kPa]" for name in NAMES}}
    text = foreign_plant.write_csv(tmp_path / "a.csv", rig).read_text()
    head, rows = text.split("\n", 1)
    (tmp_path / "a.csv").write_text(",".join(names.get(name, name) for name in head.split(",")) + "\n" + rows)
    kilo = packed(tmp_path / "b.h5", rig, {"units": "N"})
    with h5py.File(kilo, "r+") as file:
        file["t"].attrs["units"], file["Cp"].attrs["units"] = "milliseconds since 2026-01-01", "kPa"
    alone = rig | {"Cp": np.where(np.array(NAMES) == "x.y", values["Cp"], rig["Cp"])}
    for path, texts in (
        (tmp_path / "a.csv", ["t=0.005s", "Cd=-40 N", "Cp=375Pa"]),
        (tmp_path / "a.csv", ["t=5", "Cd=-0.04kN", "Cp=3.75mbar", "x.y=0.375"]),
        (kilo, ["t=5ms", "Cd=-40", "Cp=375Pa"]),
        (foreign_plant.write_npz(tmp_path / "c.npz", alone), ["t=5ms", "Cd=-40N", "x.y=1", "Cp=0.375"]),
    ):
        episode = imported(path, layout, references=references_of(texts)).episodes[0]
        for name in REQUIRED:
            np.testing.assert_allclose(episode.series[name], values[name], rtol=1e-9, atol=1e-12, err_msg=name)
    known = {"t": [5.0, "ms"], "Cd": [-40.0, "N"], "x.y": [1.0, None], "Cp": [0.375, None]}
    assert episode.provenance["references"] == known
    for path, texts, message in (
        (tmp_path / "a.csv", [], r"'t \[ms\]' is in 'ms'; t must be without dimension: give W / U_inf as in --ref"),
        (tmp_path / "a.csv", ["t=5ms", "Cd=4Pa"], r"'Cd \(N\)' is in 'N' in the file, but --ref"),
        (kilo, ["t=5ms", "Cd=40N"], "'Cp' is in 'kPa'; .* --reference Cp=240Pa"),
        (packed(tmp_path / "d.h5", values, {"units": "1"}), ["Cd=40N"], "'Cd' is in '1' in the file"),
        (kilo, ["t=5ms", "Cd=40N", "Cp=-1kPa"], "--reference Cp=-1kPa: a dynamic pressure must be positive"),
        (kilo, ["drag=1"], "--reference drag=1: 'drag' is neither a series nor a sensor"),
    ):
        with pytest.raises(DatasetError, match=message):
            imported(path, layout, references=references_of(texts))
    for texts in (["Cd"], ["Cd=N"], ["Cd=0N"], ["=4"], ["Cd=1", "Cd=2"]):
        with pytest.raises(ConfigError, match="--reference"):
            references_of(texts)


def test_matlab_files_old_and_new_are_tables(tmp_path, layout):
    """SciPy writes version 5; 7.3 is HDF5 behind 512 bytes, with its axes the other way round and texts as numbers."""
    values = foreign_plant.series(30, 3)
    turned, names = NAMES[::-1], np.array([*NAMES[::-1]], dtype=object)
    matrix = values | {"Cp": values["Cp"][:, ::-1]}
    savemat(tmp_path / "a.mat", matrix | {"taps": names, "info": {"rig": "north", "q": 375.0}})
    savemat(tmp_path / "b.mat", {"run": values | {"Cp": values["Cp"].T}}, do_compression=True)
    with h5py.File(tmp_path / "c.mat", "w", userblock_size=512) as file:
        for name, array in matrix.items():
            file.create_dataset(name, data=np.atleast_2d(array).T if array.ndim == 2 else array[None, :])
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        references = []
        for k, tap in enumerate(turned):
            cell = file.create_dataset(f"#refs#/{k}", data=np.array([[ord(one)] for one in tap], dtype=np.uint16))
            cell.attrs["MATLAB_class"] = np.bytes_("char")
            references.append(cell.ref)
        file.create_dataset("taps", data=np.array([references]).T, dtype=h5py.ref_dtype)
        file["taps"].attrs["MATLAB_class"] = np.bytes_("cell")
    told: list[str] = []
    for name, renamed in (("a.mat", {}), ("b.mat", {one: f"run/{one}" for one in values}), ("c.mat", {})):
        found = imported(tmp_path / name, layout, renamed=renamed, told=lambda path, note: told.append(note))
        for one in REQUIRED:
            np.testing.assert_array_equal(found.episodes[0].series[one], values[one])
    assert told == ["not used: info/rig, info/q"]
    cells = np.array([{"rig": 1.0}, np.zeros(3)], dtype=object)
    savemat(tmp_path / "a.mat", values | {"log": cells})
    np.testing.assert_array_equal(imported(tmp_path / "a.mat", layout).episodes[0].series["Cp"], values["Cp"])
    savemat(tmp_path / "a.mat", matrix | {"taps": np.array(["elsewhere", *turned[1:]], dtype=object)})
    with pytest.raises(DatasetError, match=f"'taps' contains the columns elsewhere, .*but not the sensor {turned[0]}"):
        imported(tmp_path / "a.mat", layout)


def test_one_sensor_or_one_row_is_read_from_matlab_too(tmp_path):
    """SciPy drops MATLAB's axes of length 1."""
    values = foreign_plant.series(20, 3)
    for rows, sensors in ((20, 1), (1, 7), (1, 1)):
        layout = SensorLayout.of(NAMES[:sensors], np.array(POSITIONS[:sensors]))
        part = values | {"Cp": values["Cp"][:, :sensors]}
        savemat(tmp_path / "a.mat", {name: array[:rows] for name, array in part.items()})
        series = imported(tmp_path / "a.mat", layout).episodes[0].series
        np.testing.assert_array_equal(series["Cp"], values["Cp"][:rows, :sensors])
        np.testing.assert_array_equal(series["Cd"], values["Cd"][:rows])


def test_remarks_empty_columns_and_objects_are_told_and_not_in_the_way(tmp_path, layout):
    """numpy.savetxt writes the header after a #; others write remarks above it, a byte order mark, or the separator."""
    values = foreign_plant.series(20, 3)
    path = foreign_plant.write_csv(tmp_path / "a.csv", values)
    plain = path.read_text().splitlines()
    told: list[str] = []
    for lines, unread in (
        ([f"# {plain[0]}", *plain[1:]], None),
        (["# my rig, 2026", "", *plain], None),
        ([f"\ufeff{plain[0]}\r", *plain[1:]], None),
        (["\ufeffsep=,\r", *plain], None),
        ([plain[0], *(f"{line},," for line in plain[1:])], None),
        ([f"{line},," for line in plain], ", ".join(f"column {k}, which has no name and is empty" for k in (12, 13))),
        ([f",{plain[0]}", *(f"{k},{line}" for k, line in enumerate(plain[1:]))], "column 1, which has no name"),
    ):
        path.write_text("\n".join([*lines, ",,,,"]) + "\n", encoding="utf-8")
        found = imported(path, layout, told=lambda path, note: told.append(note)).episodes[0]
        for name in ("t", "Cp"):
            np.testing.assert_array_equal(found.series[name], values[name])
        assert told[-1:] == ([] if unread is None else [f"not used: {unread}"])
    path = foreign_plant.write_npz(tmp_path / "b.npz", values | {"about": np.array({"rig": 1})})
    np.testing.assert_array_equal(imported(path, layout).episodes[0].series["Cd"], values["Cd"])
    (tmp_path / "s.csv").write_text("name,x,y,z\nup,1.0,0.5,0.1\ndown,1.0,-0.5,0.2\n")
    read_sensors(tmp_path / "s.csv", symmetric=True, told=lambda path, note: told.append(note))
    assert told[-1] == "not used: z; a position has only x and y"


def test_wrong_arguments_and_sensors_are_refused(tmp_path, layout):
    one = EpisodeSource(path=foreign_plant.write_npz(tmp_path / "a.npz", foreign_plant.series(20, 3)), role="train")
    two = EpisodeSource(path=tmp_path / "a.csv", role="test")
    nothing = dict[str, str]()
    for sources, renamed, message in (
        ([], nothing, "no data file is given"),
        ([one, two], nothing, "two files would make an episode called 'a'"),
        ([replace(one, named="a\u202fb")], nothing, "field 'name' must be printable text"),
        ([one], {"drag": "Cd"}, "--map drag=Cd: 'drag' is neither a series nor a sensor"),
    ):
        with pytest.raises(DatasetError, match=message):
            assemble(sources, layout, FACTS, renamed=renamed)
    with pytest.raises(DatasetError, match="must be given"):
        assemble([one], layout, PlantFacts(control_period=PERIOD))
    # Sensors that do not fit are refused.
    for text, message in (
        ("a,1,1\nb,1,-1\n", "'1' occurs twice; the first line must have the names"),
        ("name,x,y\na,1,0\na,2,0\n", "sensor 'a': two sensors have this name"),
        ("name,x,y\na,1,left\n", "line 2, column 'y': 'left' is not a number"),
        ("name,x,y\na,1,0\nCd,1,0\n", "line 3: a sensor cannot be called 'Cd'"),
    ):
        (tmp_path / "s.csv").write_text(text)
        with pytest.raises(DatasetError, match=message) as caught:
            read_sensors(tmp_path / "s.csv", symmetric=True)
        assert "s.csv" in str(caught.value)
