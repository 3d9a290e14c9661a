"""Cases of OpenFOAM, written here as its versions do, become episodes with the values that they have."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contract.errors import DatasetError
from contract.recording.dataset import Episode
from contract.recording.episode import PlantFacts
from contract.recording.importing.assemble import EpisodeSource, assemble
from contract.recording.importing.source_file import references_of
from contract.sensor_layout import SensorLayout
from tests.oscillating_wake import LIMIT, NAMES, PERIOD, POSITIONS, Array, series

LAYOUT = SensorLayout.of(NAMES, np.array(POSITIONS), base=[2, 3], symmetric=True)
VALUES = series(2, False, 60)
AT_REST = "# Force coefficients\n# magUInf     : {}\n# Aref        : 0.1\n# Time{}\n"


def probes(order: list[int], *, scale: float = 1.0, shift: float = 0.0, old: bool = False) -> str:
    places = [(scale * POSITIONS[k][0] + shift, scale * POSITIONS[k][1], 0.05) for k in order]
    if old:
        lines = [f"#  {axis}  {'  '.join(f'{place[i]:g}' for place in places)}\n" for i, axis in enumerate("xyz")]
        return "".join(lines) + "# Time\n"
    lines = [f"# Probe {k} ({x:g} {y:g} {z:g})\n" for k, (x, y, z) in enumerate(places)]
    return "".join(lines) + f"#       Probe  {' '.join(map(str, range(len(order))))}\n#        Time\n"


def write(path: Path, header: str, *columns: Array) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = ("\t".join(f"{value:.12g}" for value in row) for row in np.column_stack(columns))
    path.write_text(header + "\n".join(rows) + "\n")


def case(folder: Path, *, speed: float | None = 1.0, second: float = 1.0, header: str = probes([0, 1, 2, 3])) -> Path:
    """A whole run of 60 periods; p is kinematic."""
    post, t = folder / "postProcessing", second * VALUES["t"]
    write(post / "probes/0/p", header, t, 0.5 * (speed or 1.0) ** 2 * VALUES["Cp"])
    names = AT_REST.format(speed, "\tCm\tCd\tCl\tCl(f)\tCl(r)") if speed else "# Time\tCm\tCd\tCl\tCl(f)\tCl(r)\n"
    zero = np.zeros(60)
    write(post / "forces/0/forceCoeffs.dat", names, t, zero, VALUES["Cd"], VALUES["Cl"], zero, zero)
    return folder


def read(path: Path, *references: str, **more: Any) -> Episode:
    facts = PlantFacts(control_period=PERIOD, action_limit=LIMIT)
    return assemble(
        [EpisodeSource(path=path, role="train")], LAYOUT, facts, references=references_of(references), **more
    ).episodes[0]


def same(episode: Episode) -> None:
    for name in ("Cp", "Cd", "Cl"):
        np.testing.assert_allclose(episode.series[name], VALUES[name], atol=1e-9, err_msg=name)


def test_p_is_kinematic_and_probes_are_found_by_their_places(tmp_path):
    told: list[str] = []
    path = case(tmp_path / "run 1")
    for inside in ("", "postProcessing", "postProcessing/probes/0/p", "postProcessing/forces/0/forceCoeffs.dat"):
        found = read(path / inside, told=lambda path, note: told.append(note))
        same(found)
        assert (found.name, float(np.abs(found.series["action"]).max())) == ("run 1", 0.0)
    assert told[:2] == [
        "not used: Cm, Cl(f), Cl(r)",
        "no actions.csv beside postProcessing: the case counts as uncontrolled, with an action of 0",
    ]
    # 20 m/s past 0.1 m, which U_inf of the coefficients and one option tell, or two.
    same(read(case(tmp_path / "a", speed=20.0, second=0.005), "t=5ms"))
    same(read(case(tmp_path / "b", speed=None), "t=1s", "Cp=0.5m2/s2"))
    # Versions before 2.3, probes in another order and more of them, and metres from another origin.
    same(read(case(tmp_path / "c", header=probes([0, 1, 2, 3], old=True))))
    same(read(case(tmp_path / "d", header=probes([0, 1, 2, 3], scale=0.1, shift=7.0))))
    turned = case(tmp_path / "e")
    pressures = np.column_stack([VALUES["Cp"][:, [3, 1, 0, 2]], np.full(60, -1e300)]) / 2
    more = probes([3, 1, 0, 2, 2]).replace("# Probe 4 (1 0.3", "# Probe 4 (9 9")
    write(turned / "postProcessing/probes/0/p", more, VALUES["t"], pressures)
    same(read(turned))


def test_a_case_that_was_continued_and_written_at_other_times_is_put_together(tmp_path):
    post, t, p = tmp_path / "r/postProcessing", VALUES["t"], VALUES["Cp"] / 2
    # The first run went on to row 40, from which nothing counts: the second started at row 30, the third at 50.
    for start, rows in ((0.0, slice(0, 40)), (t[30], slice(31, 52)), (t[50], slice(50, 60))):
        later = (t[rows] > t[30] + 1e-6) & (start == 0.0)
        write(post / f"probes/{start:g}/p", probes([0, 1, 2, 3]), t[rows], p[rows] + 9.0 * later[:, None])
    header = AT_REST.format(1, "\tCd\tCs\tCl\tCmRoll")
    # Forces at every third of a period, on straight lines between the rows; the restart wrote beside the first file.
    fine = np.round(np.arange(0, 59 * 3 + 1) * PERIOD / 3, 9)
    drag, lift = (np.interp(fine, t, VALUES[name]) for name in ("Cd", "Cl"))
    for name, rows in (("coefficient.dat", slice(0, 100)), ("coefficient_0.dat", slice(0, None))):
        columns = (fine, drag + 5.0 * (name == "coefficient.dat"), 0 * fine, lift, 0 * fine)
        write(post / f"forces/0/{name}", header, *(column[rows] for column in columns))
    same(read(tmp_path / "r"))
    # Commands as they were given, each in force until the next.
    (tmp_path / "r/actions.csv").write_text("t,action\n-1,0.05\n0.3,0.1\n0.9,-0.2\n")
    found = read(tmp_path / "r")
    assert found.series["action"][:5].tolist() == [0.05, 0.1, 0.1, -0.2, -0.2] and found.initial_action == 0.05


def test_a_case_that_does_not_fit_is_refused_by_file_and_reason(tmp_path):
    def text(folder: str, name: str, old: str, new: str) -> Path:
        path = case(tmp_path / folder) / "postProcessing" / name
        path.write_text(path.read_text().replace(old, new, 1))
        return tmp_path / folder

    p, forces = "probes/0/p", "forces/0/forceCoeffs.dat"
    for path, references, message in (
        (case(tmp_path / "a", speed=20.0, second=0.005), (), r"times are in s, U_inf is 20 m/s: give W / U_inf as in"),
        (case(tmp_path / "b", speed=None), (), "states no magUInf; p is kinematic, so give U_inf"),
        (case(tmp_path / "l"), ("Cp=0.6Pa",), "'p' is in 'm2/s2' in the file, but --reference Cp=0.6Pa is not"),
        (text("m", forces, ": 1.0", ": 0"), ("t=1s",), "states no magUInf"),
        (case(tmp_path / "c"), ("t=0.2s",), r"rows are up to 1\.5 W / U_inf apart"),
        (case(tmp_path / "d", second=3.0), (), "rows are up to 0.9 W / U_inf apart: write one row per control"),
        (text("e", forces, "\tCl\t", "\tlift\t"), (), "no column 'Cl' for Cl; the file has Time, Cm, Cd, lift"),
        (text("f", p, "Probe 2 (1 ", "Probe 2 (2 "), (), "or more than one of the 4 probes, is at the sensor p3"),
        (text("g", p, "\n0.3\t", "\n0.3\tnan\t"), (), r"line 8 has 6 values: must have 5"),
        (text("h", p, "\n0.3\t", "\nhalf\t"), (), "line 8: could not convert"),
        (text("j", p, "\n0.6\t", "\n0.2\t"), (), r"times do not rise from row 1 to 2: 0\.3, 0\.2"),
        (text("i", p, f"{VALUES['Cp'][4, 1] / 2:.12g}", "-1e300"), (), "probe 1 is not in the mesh"),
        (tmp_path, (), "is a folder without postProcessing"),
    ):
        with pytest.raises(DatasetError, match=message) as caught:
            read(path, *references)
        assert "\n" not in str(caught.value)
    second = case(tmp_path / "k") / "postProcessing"
    (second / "probes").rename(second / "wall")
    case(tmp_path / "k")
    with pytest.raises(DatasetError, match=r"several contain probes of p, name one: .*probes, .*wall"):
        read(tmp_path / "k")
    same(read(tmp_path / "k/postProcessing/wall/0/p"))
    (second / "wall/6").mkdir()
    (second / "wall/6/p").write_text(probes([1, 0, 2, 3]) + "6.3 1 1 1 1\n")
    with pytest.raises(DatasetError, match="its header differs from that of"):
        read(tmp_path / "k/postProcessing/wall")
