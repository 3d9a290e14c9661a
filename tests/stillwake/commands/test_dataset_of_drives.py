"""`stillwake dataset import` of logs: the loop's own capture is the recorded run, and faults end in one line."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can
import cantools
import numpy as np
import pytest

from contract.config.tree import Config
from contract.config.vehicle import BackgroundConfig, BusConfig
from contract.recording import dataset
from contract.recording.dataset import CP_QUANTUM, QUANTUM
from contract.release import bundle
from contract.sensors import TRUCK
from firmware_sim.bench.closed_loop import run_closed_loop
from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.series_csv import write_csv
from tests.can_bridge.drives.drive_log import FLOW, KEY, PRESSURE, STEP, drive, log_of, write
from tests.conftest import Outcome

Cli = Callable[..., Outcome]

FACTS = ("--period", 0.2, "--limit", 0.075, "--asymmetric")
NAMES = ("lower_36", "base_7", "upper_39", "base_0")


def write_sensors(path: Path, names: tuple[str, ...] = NAMES) -> Path:
    rows = (f"{name},{x},{y},0" for name, (x, y) in zip(names, TRUCK.positions[TRUCK.indices(names)], strict=True))
    path.write_text("\n".join(["name,x,y,base", *rows]) + "\n")
    return path


def forces(rows: int) -> dict[str, Any]:
    """In t_c since the first pressure, four to a control period."""
    t = 0.05 * np.arange(-4, 4 * rows + 4)
    return {"t": t, "Cd": 1.0 + 0.1 * np.sin(t), "Cl": np.cos(t)}


def write_forces(path: Path, values: dict[str, Any], header: str = "t [t_c],Cd,Cl") -> Path:
    table = np.column_stack([values["t"], values["Cd"], values["Cl"]])
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.17g")
    return path


@dataclass(frozen=True)
class Place:
    """A folder with sensors.csv, drive.log of 200 rows, and forces.csv."""

    folder: Path
    cli: Cli

    def call(self, *words: object, log: object = None) -> Outcome:
        given = self.folder / "drive.log" if log is None else log
        sensors = self.folder / "sensors.csv"
        return self.cli(
            "dataset", "import", self.folder / "my.h5", "--sensors", sensors, *FACTS, "--train", given, *words
        )

    @property
    def read(self) -> dataset.Dataset:
        return dataset.read(self.folder / "my.h5")


@pytest.fixture
def place(tmp_path: Path, cli: Cli) -> Place:
    write_sensors(tmp_path / "sensors.csv")
    write(tmp_path / "drive.log", log_of(drive("fd", 200, 1)))
    write_forces(tmp_path / "forces.csv", forces(200))
    return Place(tmp_path, cli)


def same_forces(episode: dataset.Episode, first: int = 0) -> None:
    """Of `forces`, at the rows."""
    t = 0.2 * (first + np.arange(len(episode)))
    np.testing.assert_allclose(episode.series["t"], t, atol=1e-9)
    # A line over 0.05 t_c misses sin by 0.05^2 / 8, the log's microseconds are 1e-5 t_c, and 16 bits hold Cd to 2^-15.
    for name, expected in (("Cd", 1.0 + 0.1 * np.sin(t)), ("Cl", np.cos(t))):
        np.testing.assert_allclose(episode.series[name], expected, atol=0.05**2 / 8 + 1e-5 + QUANTUM)


@pytest.mark.slow  # whole runs of the loop
@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize(("frames", "load"), [("fd", 0.6), ("classic", 0.0)])
def test_the_loops_own_capture_is_the_run_within_half_a_step(
    frames: Any, load: float, cli: Cli, tmp_path: Path, short_release: Path
) -> None:
    release = bundle.load(short_release)
    config = Config(bus=BusConfig(frames=frames, background=BackgroundConfig(load=load)))
    run: RunLog = run_closed_loop(
        tmp_path / "run", release, config, lead_in=4.0, controlled=10.0, settle=0.0, averages=False
    )
    write_csv(tmp_path / "run.csv", run)
    sensors = write_sensors(tmp_path / "sensors.csv", release.manifest.sensors)
    made = tmp_path / "my.h5"
    outcome = cli(
        *("dataset", "import", made, "--sensors", sensors, *FACTS),
        *("--train", tmp_path / "run" / "frames.log", "--forces", tmp_path / "run.csv"),
    )
    assert outcome.code == 0, outcome.err
    (episode,) = dataset.read(made).episodes
    # What the jets did in the run's first period was asked for before the log begins: the ECU plans a period ahead.
    assert len(episode) == 69
    assert np.ptp(run.series["action"]) > 0.01
    np.testing.assert_allclose(
        episode.series["Cp"], run.series["wall_Cp"][1:], atol=STEP[frames] / 2 / PRESSURE + CP_QUANTUM / 2
    )
    # The run's own series of actions is what the jets had reached at each sample: what was commanded one before.
    reached = run.series["action"][1:]
    np.testing.assert_allclose(episode.series["action"][:-1], reached[1:], atol=1e-4 / FLOW)
    assert episode.initial_action == reached[0] == 0.0
    for name in ("Cd", "Cl"):
        expected = run.series[name][1:]
        # Rows count from the first, so that what moves all alike cancels. Frames differ by queueing, stuff bits and
        # microseconds of the log; the medians of 70 leave 50 us of it at most, which are 5e-4 t_c.
        late = 5e-4 * np.abs(np.diff(expected)).max() / 0.2
        np.testing.assert_allclose(episode.series[name], expected, atol=QUANTUM / 2 + late)


# python-can writes no CAN FD frames into TRC.
def test_every_format_of_logs_gives_the_drive(place: Place) -> None:
    for kind, suffix in (("fd", ".log"), ("fd", ".asc"), ("secured", ".blf"), ("classic", ".trc")):
        one = drive(kind, 200, 2)
        log = write(place.folder / f"other{suffix}", log_of(one))
        outcome = place.call("--forces", place.folder / "forces.csv", "--overwrite", log=log)
        assert outcome.code == 0, outcome.err
        (episode,) = place.read.episodes
        assert (episode.name, len(episode)) == ("other", 200)
        np.testing.assert_allclose(episode.series["Cp"], one.Cp, atol=CP_QUANTUM / 2)
        np.testing.assert_allclose(episode.series["action"], one.action, atol=1e-12)
        same_forces(episode)


def test_a_secured_log_is_checked_where_the_key_is_given(place: Place) -> None:
    key = place.folder / "bus.key"
    key.write_text(KEY.hex() + "\n")
    key.chmod(0o600)
    log = write(place.folder / "secured.blf", log_of(drive("secured", 200, 3)))
    words = ("--forces", place.folder / "forces.csv")
    unchecked = place.call(*words, log=log)
    assert unchecked.code == 0, unchecked.err
    assert "authentication codes were not checked: give the key with --set bus.key=FILE" in unchecked.out
    checked = place.call(*words, "--set", f"bus.key={key}", "--overwrite", log=log)
    assert checked.code == 0, checked.err
    assert "not checked" not in checked.out
    key.write_text(bytes(range(2, 18)).hex())
    refused = place.call(*words, "--set", f"bus.key={key}", "--overwrite", log=log)
    assert refused.code != 0
    assert "bus.key is not the key of this drive" in refused.err


def test_forces_come_from_a_second_log_with_its_own_dbc(place: Place) -> None:
    balance: Any = cantools.database.load_string(
        'VERSION ""\nBU_: Balance\n'
        'BO_ 416 Drag: 4 Balance\n SG_ Coefficient : 0|32@1- (0.00001,0) [0|0] "" Vector__XXX\n'
        'BO_ 2147488665 Side: 4 Balance\n SG_ Coefficient : 0|32@1- (0.00001,0) [0|0] "" Vector__XXX\n'
    )
    (place.folder / "balance.dbc").write_text(balance.as_dbc_string())
    # A BLF keeps no time that lies before 1990.
    start = 1.7e9
    write(place.folder / "drive.log", log_of(drive("fd", 200, 1), start_s=start))
    values, messages = forces(200), []
    for t, cd, cl in zip(values["t"], values["Cd"], values["Cl"], strict=True):
        for spec, value in zip(balance.messages, (cd, cl), strict=True):
            messages.append(
                can.Message(
                    timestamp=start + 0.1 * t,
                    arbitration_id=spec.frame_id,
                    is_extended_id=spec.is_extended_frame,
                    data=spec.encode({"Coefficient": value}),
                )
            )
    second = write(place.folder / "balance.asc", messages)
    third = write(place.folder / "balance.blf", messages)
    words = ("--forces-dbc", place.folder / "balance.dbc", "--forces-map", "Cd=Drag.Coefficient")
    # An ASC has its times from its own beginning, 0.2 t_c before the first pressure.
    for given in (
        ("--forces", third),
        ("--forces", second, "--forces-clock", "start", "--forces-shift", -0.02),
    ):
        outcome = place.call(*words, "--forces-map", "Cl=Side.Coefficient", *given, "--overwrite")
        assert outcome.code == 0, outcome.err
        same_forces(place.read.episodes[0])
    for wrong, text in (
        ("Cl=Side.Nothing", "message Side has no signal 'Nothing' for Cl; it has Coefficient"),
        ("Cl=Lift.Coefficient", "no message 'Lift' for Cl; it has Drag, Side"),
        ("Cl=Side", "write Cl=MESSAGE.SIGNAL"),
    ):
        refused = place.call(*words, "--forces-map", wrong, "--forces", third, "--overwrite")
        assert refused.code != 0
        assert text in refused.err


def test_a_gap_is_refused_or_makes_two_episodes_by_name(place: Place) -> None:
    one = drive("fd", 200, 4)
    write(place.folder / "drive.log", [m for i, m in enumerate(log_of(one)) if not 200 <= i < 210])
    words = ("--forces", place.folder / "forces.csv")
    refused = place.call(*words)
    assert (refused.code, refused.err.count("\n")) == (1, 1)
    assert "no pressures for 5 control periods at 2.000 s; --fill allows 2; with --split" in refused.err
    assert not (place.folder / "my.h5").exists()
    outcome = place.call(*words, "--split")
    assert outcome.code == 0, outcome.err
    assert "no pressures for 5 control periods at 2.000 s: cut there" in outcome.out
    first, second = place.read.episodes
    assert (first.name, second.name, first.role, second.role) == ("drive 1", "drive 2", "train", "train")
    assert (len(first), len(second)) == (100, 94)
    same_forces(first)
    same_forces(second, first=106)
    assert place.call(*words, "--fill", 5, "--overwrite").code == 0
    (whole,) = place.read.episodes
    assert len(whole) == 200


def test_logs_and_tables_in_one_import(place: Place) -> None:
    """A directly recorded CSV of the same drive gives the same episode as its log."""
    one, values = drive("fd", 200, 1), forces(200)
    rows = slice(4, 804, 4)
    columns = {"action": one.action, "Cd": values["Cd"][rows], "Cl": values["Cl"][rows]}
    columns |= dict(zip(NAMES, one.Cp.T, strict=True))
    table = place.folder / "table.csv"
    np.savetxt(table, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    outcome = place.call("--test", table, "--forces", place.folder / "forces.csv")
    assert outcome.code == 0, outcome.err
    log, direct = place.read.episodes
    assert (log.name, direct.name, direct.role) == ("drive", "table", "test")
    for name in ("t", "action", "Cp", "Cd", "Cl"):
        # Cd and Cl by 1 us of the log's clock, all by the 16 bits that they are stored in.
        np.testing.assert_allclose(log.series[name], direct.series[name], atol=CP_QUANTUM, err_msg=name)
    assert log.provenance["messages"] == "CAN FD"


def broken(**arrays: Any) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        values = forces(200)
        header = arrays.get("header", "t [t_c],Cd,Cl")
        values |= {name: change(values[name]) for name, change in arrays.items() if name != "header"}
        return write_forces(folder / "other.csv", values, header)

    return make


def replaced(k: int, value: float) -> Callable[[Any], Any]:
    def change(array: Any) -> Any:
        changed = array.copy()
        changed[k] = value
        return changed

    return change


def test_forces_that_do_not_fit_are_refused_in_one_line(place: Place) -> None:
    cases: list[tuple[Callable[[Path], Path], tuple[str, ...], str]] = [
        (broken(header="t,Cd,Cl"), (), "give with --forces-clock what its times are"),
        (broken(header="t [t_c],drag,Cl"), (), "no column 'Cd' for the forces' table; it has t [t_c], drag, Cl"),
        (broken(Cd=replaced(7, np.nan)), (), "line 9, column 'Cd': nan is not finite"),
        (broken(t=replaced(7, 0.0)), (), "the times of 'Cd' do not rise from row 6 to 7"),
        (broken(t=lambda t: t - 1.0), (), "it must cover them; see --forces-clock and --forces-shift"),
        (broken(t=lambda t: t + 1.0), (), "it must cover them; see --forces-clock and --forces-shift"),
        (broken(t=lambda t: np.where(t > 20.0, t + 1.0, t)), (), "'Cd' has no value between 1002 and 1002.1"),
        (broken(), ("--forces-clock", "log"), "it must cover them"),
        (broken(Cl=lambda cl: 400 * cl), (), "'Cl' reaches 400, a coefficient stays below"),
    ]
    for make, words, text in cases:
        outcome = place.call("--forces", make(place.folder), *words)
        assert (outcome.code, outcome.err.count("\n")) == (1, 1), outcome.err
        assert text in outcome.err, text
        assert not (place.folder / "my.h5").exists(), text


def test_what_is_missing_or_contradicts_itself_is_refused_in_one_line(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(place.folder)
    cases: list[tuple[tuple[str, ...], str]] = [
        ((), "a log has no drag and lift, and training needs them: give them with --forces"),
        (
            ("--forces", "a.csv", "--forces", "b.csv"),
            "--forces b.csv: is the second one; with more than one write LOG=",
        ),
        (("--forces", "missing.csv"), "missing.csv: no such file"),
        (("--forces", "forces.xyz"), "forces.xyz: no such file"),
        (("--forces", "drive.log"), "forces in a log need --forces-dbc FILE"),
        (("--forces", "forces.csv", "--set", "operating_point.speed=50"), "20 ms apart, the control period is 10 ms"),
        (("--forces", "forces.csv", "--set", "mpc.horizon=3"), "`dataset import` does not use it"),
        (("--forces", "forces.csv", "--dynamic-pressure", "300"), "operating_point has 375 Pa"),
        (("--forces", "forces.csv", "--limit", "0.01"), "beyond the limit of 0.01"),
        (("--forces", "forces.csv", "--set", "bus.frames=classic"), "holds no pressure, PressureClassic (0x121)"),
    ]
    for words, text in cases:
        outcome = place.call(*words)
        assert (outcome.code, outcome.err.count("\n")) == (1, 1), outcome.err
        assert text in outcome.err, text
        assert not (place.folder / "my.h5").exists(), text


def test_options_of_logs_without_a_log_are_refused(place: Place) -> None:
    table = place.folder / "table.csv"
    table.write_text("action\n0\n")
    for words in (("--split",), ("--forces", place.folder / "forces.csv"), ("--set", "operating_point.speed=20")):
        outcome = place.call(*words, log=table)
        assert outcome.code == 1
        assert "are for CAN logs, and no file is one" in outcome.err


def test_sensors_are_those_of_the_message(place: Place) -> None:
    write_sensors(place.folder / "sensors.csv", NAMES[:3])
    outcome = place.call("--forces", place.folder / "forces.csv")
    assert outcome.code == 1
    assert "a Pressure message has 4 sensors, --sensors names 3" in outcome.err
