"""Forces beside a log: what is on straight lines comes out exactly, what does not cover the rows is refused."""

import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from contract.errors import DatasetError
from contract.recording.importing.forces import ForcesTable, read_forces

T = np.array([0.0, 0.5, 1.0, 2.0])
VALUES = {"t": T, "Cd": 1.0 + T, "Cl": -2.0 * T}
SINCE_1970 = 1795773600.25
"""A start in seconds since 1970: times are stated to a tenth of a millisecond."""


def series(t: Any, values: Any) -> ForcesTable:
    cd = np.asarray(values, float)
    names = {"t": "t", "Cd": "Cd", "Cl": "Cl"}
    return ForcesTable(path=Path("forces.csv"), names=names, t=np.asarray(t, float), values={"Cd": cd, "Cl": -cd})


def test_what_lies_outside_or_in_a_gap_is_refused_by_time():
    one = series([0.0, 0.1, 0.5, 0.6], [1.0, 2.0, 3.0, 4.0])
    wide = {"longest_gap": 0.2, "slack": 0.01}
    late = series(SINCE_1970 + one.t, one.values["Cd"])
    for table, start, at, text in (
        (one, 0.0, [-0.02, 0.1], r"has times from 0 to 0\.6 s .* from -0\.02 to 0\.1 s: the forces must"),
        (one, 0.0, [0.0, 0.3], r"no value between 0\.1 and 0\.5 s .* no more than 0\.2 s apart"),
        (late, SINCE_1970, [-0.02, 0.1], "from 1795773600.25 to 1795773600.85 s .* from 1795773600.23 to"),
        (late, SINCE_1970, [0.0, 0.3], "no value between 1795773600.35 and"),
    ):
        with pytest.raises(DatasetError, match=text):
            table.at(start + np.array(at), **wide)
    # A row on the edge of the gap needs no line across it; one by a hair outside takes the value there.
    found = one.at(np.array([0.0, 0.075, 0.1, 0.5, 0.605]), **wide)
    np.testing.assert_allclose([found["Cd"], -found["Cl"]], [[1.0, 1.75, 2.0, 3.0, 4.0]] * 2)


def test_series_that_are_none_are_refused():
    for t, text in (
        ([0.0, 1.0, 1.0], "do not rise from row 1 to 2: 1, 1"),
        (SINCE_1970 + np.array([0.0, 0.0016, 0.0013]), r"row 1 to 2: 1795773600\.2516, 1795773600\.2513"),
        ([0.0], "has 1 rows, must have at least two"),
    ):
        with pytest.raises(DatasetError, match=text):
            series(t, np.ones(len(t)))


def write(path: Path, values: dict[str, Any]) -> Path:
    if path.suffix == ".npz":
        np.savez(path, **values)
    elif path.suffix == ".h5":
        with h5py.File(path, "w") as file:
            for name, array in values.items():
                file[name] = array[:, None]
    else:
        table = np.column_stack(list(values.values()))
        np.savetxt(path, table, delimiter=",", header=",".join(values), comments="", fmt="%.17g")
    return path


def test_tables_are_read_whatever_holds_them(tmp_path):
    for suffix in (".csv", ".npz", ".h5"):
        for names, clock in ((("t [t_c]", "Cd [1]", "Cl"), "t_c"), (("time", "drag", "Cl [1]"), None)):
            renamed = {"t": "time", "Cd": "drag"} if clock is None else {}
            path = write(tmp_path / f"forces{suffix}", dict(zip(names, VALUES.values(), strict=True)))
            found = read_forces(path, renamed)
            assert found.clock == clock
            assert found.names == dict(zip(("t", "Cd", "Cl"), names, strict=True))
            for name, forces in found.values.items():
                np.testing.assert_array_equal(forces, VALUES[name])
            np.testing.assert_array_equal(found.t, T)
    for values, text in (
        ({"t": T, "Cd": T}, "no column 'Cl' for the forces' table; the file has t, Cd"),
        ({"t": T, "Cd": T[:2], "Cl": T}, "'Cd' has 2 rows; 't' has 4"),
        ({"t [days]": T, "Cd": T, "Cl": T}, "no column 't' for the forces' table; the file has t [days]"),
        ({"t": T, "Cd [lbf]": T, "Cl": T}, "no column 'Cd' for the forces' table; the file has t, Cd [lbf]"),
        ({"t": T, "Cd (N)": T, "Cl": T}, "Cd (N)' is in 'N'; Cd must be without dimension"),
    ):
        with pytest.raises(DatasetError, match=re.escape(text)):
            read_forces(write(tmp_path / "forces.npz", values), {})
    days = write(tmp_path / "forces.h5", VALUES)
    with h5py.File(days, "r+") as file:
        file["t"].attrs["units"] = "days since 2026-11-30"
    with pytest.raises(DatasetError, match="'t' is in 'days since 2026-11-30'; times must be in s, ms"):
        read_forces(days, {})
