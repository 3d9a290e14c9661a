"""`stillwake dataset import` of logs: the loop's own capture is the recorded run, and faults end in one line."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contract.config.tree import Config
from contract.config.vehicle import BackgroundConfig, BusConfig
from contract.recording import dataset
from contract.recording.dataset import CP_QUANTUM, QUANTUM
from contract.release import bundle
from contract.sensors import TRUCK
from firmware_sim.bench.closed_loop import run_closed_loop
from firmware_sim.bench.simulation import Spans
from firmware_sim.runs.run_page.measurement import write_csv
from tests.can_bridge.drives.drive_log import FLOW, KEY, PRESSURE, STEP, drive, log_of, speed
from tests.can_bridge.logs.log_texts import write
from tests.conftest import Outcome

FACTS = ("--set", "flow.control_period=0.2", "--set", "flow.action_limit=0.075", "--asymmetric")
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
    cli: Callable[..., Outcome]

    def call(self, *words: object, log: object = None, status: int = 0) -> Outcome:
        given = self.folder / "drive.log" if log is None else log
        more = ("--layout", self.folder / "sensors.csv", *FACTS, *words)
        outcome = self.cli("dataset", "import", self.folder / "my.h5", f"train={given}", *more)
        assert outcome.code == status, outcome.err
        return outcome

    @property
    def episode(self) -> dataset.Episode:
        """The only one of the data set that was made."""
        (found,) = dataset.read(self.folder / "my.h5").episodes
        return found


@pytest.fixture
def place(tmp_path, cli) -> Place:
    write_sensors(tmp_path / "sensors.csv")
    write(tmp_path / "drive.log", log_of(drive("fd", 200, 1)))
    write_forces(tmp_path / "forces.csv", forces(200))
    return Place(tmp_path, cli)


def same_forces(episode: dataset.Episode) -> None:
    """Of `forces`, at the rows."""
    t = 0.2 * np.arange(len(episode))
    np.testing.assert_allclose(episode.series["t"], t, atol=1e-9)
    # A line over 0.05 t_c misses sin by 0.05^2 / 8, the log's microseconds are 1e-5 t_c, and 16 bits hold Cd to 2^-15.
    for name, expected in (("Cd", 1.0 + 0.1 * np.sin(t)), ("Cl", np.cos(t))):
        np.testing.assert_allclose(episode.series[name], expected, atol=0.05**2 / 8 + 1e-5 + QUANTUM)


@pytest.mark.slow  # a run of the loop
@pytest.mark.usefixtures("no_pictures")
def test_the_loops_own_capture_is_the_run_within_half_a_step(place, tmp_path, short_release, coarse):
    release = bundle.load(short_release)
    config = Config(flow=coarse.flow, bus=BusConfig(background=BackgroundConfig(load=0.6)))
    spans = Spans(lead_in=2.0, controlled=4.0, settle=0.0, averages=False)
    run = run_closed_loop(tmp_path / "run", release, config, spans, plant=coarse.plant())
    write_csv(tmp_path / "run.csv", run)
    write_sensors(tmp_path / "sensors.csv", release.manifest.sensors)
    place.call("--forces", tmp_path / "run.csv", log=tmp_path / "run" / "frames.log")
    episode = place.episode
    # What the jets did in the run's first period was asked for before the log begins: the ECU plans a period ahead.
    assert len(episode) == 29
    assert np.ptp(run.series["action"]) > 0.01
    half_a_step = STEP["fd"] / 2 / PRESSURE + CP_QUANTUM / 2
    np.testing.assert_allclose(episode.series["Cp"], run.series["wall_Cp"][1:], atol=half_a_step)
    # The run's own series of actions is what the jets had reached at each sample: what was commanded one before.
    reached = run.series["action"][1:]
    np.testing.assert_allclose(episode.series["action"][:-1], reached[1:], atol=1e-4 / FLOW)
    assert episode.initial_action == reached[0] == 0.0
    for name in ("Cd", "Cl"):
        expected = run.series[name][1:]
        # Rows count from the first, so that what moves all alike cancels. Frames differ by queueing, stuff bits and
        # microseconds of the log; the medians of 30 leave 50 us of it at most, which are 5e-4 t_c.
        late = 5e-4 * np.abs(np.diff(expected)).max() / 0.2
        np.testing.assert_allclose(episode.series[name], expected, atol=QUANTUM / 2 + late)


def test_a_log_of_any_kind_gives_the_drive_and_its_authentication_is_checked_with_the_key(place):
    """`tests/can_bridge/logs` reads every format."""
    unchecked = "authentication codes were not checked: give the key with --set bus.key=FILE"
    (place.folder / "bus.key").write_text(KEY.hex())
    (place.folder / "bus.key").chmod(0o600)
    keyed = ("--set", f"bus.key={place.folder / 'bus.key'}")
    for kind, suffix, more in (("secured", ".blf", ()), ("secured", ".blf", keyed), ("classic", ".log.gz", ())):
        one = drive(kind, 200, 2)
        log = write(place.folder / f"other{suffix}", log_of(one))
        out = place.call("--forces", place.folder / "forces.csv", "--overwrite", *more, log=log).out
        assert (unchecked in out) is (kind == "secured" and not more)
        episode = place.episode
        assert (episode.name, len(episode)) == ("other", 200)
        np.testing.assert_allclose(episode.series["Cp"], one.Cp, atol=CP_QUANTUM / 2)
        np.testing.assert_allclose(episode.series["action"], one.action, atol=1e-12)
        same_forces(episode)


def test_what_is_missing_or_contradicts_itself_is_refused(all_refused, place):
    gap = [m for i, m in enumerate(log_of(drive("fd", 200, 4))) if not 200 <= i < 210]
    write(place.folder / "gap.log", gap)
    write_forces(place.folder / "bare.csv", forces(200), "t,Cd,Cl")
    write_sensors(place.folder / "three.csv", NAMES[:3])
    (place.folder / "table.csv").write_text("action\n0\n")
    call = ("dataset", "import", "my.h5", *FACTS)
    rows = {
        "": "a log has no drag and lift, which training needs: give them with --forces",
        "--forces a.csv --forces b.csv": "--forces b.csv is a second file for all logs; write LOG=",
        "--forces drive.log=forces.csv --forces drive.log=b.csv": "drive.log already has a file of forces",
        "--forces dive.log=forces.csv": "no such file; LOG= must name one of drive.log",
        "--forces drive.log": "drive.log: a table of forces must end in",
        "--forces bare.csv": "state with --forces-clock how its times count",
        "--forces forces.csv --forces-clock log": "the forces must cover these rows",
        "--forces forces.csv --forces-shift 0.1": "must cover these rows; see --forces-clock and --forces-shift",
        "--forces forces.csv --map Cd=drag": "no column 'drag' for the forces' table; the file has t [t_c], Cd, C",
        "--forces forces.csv --set operating_point.speed=50": "20 ms apart, but the control period is 10 ms",
        "--forces forces.csv --set mpc.horizon=3": "`dataset import` does not use it",
        "--forces forces.csv --reference Cp=300Pa": "drive.log is computed with 375 Pa",
        "--forces forces.csv --channel can7": "drive.log: --channel can7: no such channel, only vcan0",
        "--forces forces.csv --log-zone Mars": "--log-zone Mars: must be a name such as Europe/Berlin or UTC",
        "--forces forces.csv --log-zone +02:00": "no log begins in local time",
    }
    all_refused((*call, "train=drive.log", "--layout", "sensors.csv"), rows)
    rows = {
        "train=gap.log --layout sensors.csv": "no pressures for 5 control periods at 2.000 s; --fill allows 2",
        "train=drive.log --layout three.csv": "a Pressure message has 4 sensors, but --layout has 3",
    }
    all_refused((*call, "--forces", "forces.csv"), rows)
    without = "are for CAN logs; no log is given"
    all_refused(
        (*call, "train=table.csv", "--layout", "sensors.csv"),
        {"--split": without, "--forces forces.csv": without, "--set operating_point.speed=20": without},
    )


def test_a_log_that_begins_in_local_time_is_read_in_its_zone_or_the_zone_is_asked_for(place):
    """12:00 at two hours east of Greenwich, as Vector's programs write it; and forces of the same day by the clock."""
    start = 1_795_773_600.0
    one = drive("fd", 200, 7)
    log = write(place.folder / "drive.blf", log_of(one, start_s=start + 7200.0))
    values = forces(200)
    at = {**values, "t": start + 0.1 * values["t"]}
    true = write_forces(place.folder / "true.csv", at, "t,Cd,Cl")
    # A balance that went on for two hours and a bit: other forces in the hours after.
    later = {"t": start + 7200.0 + 0.1 * values["t"], "Cd": values["Cd"] + 1.0, "Cl": values["Cl"]}
    long = write_forces(place.folder / "long.csv", {name: np.append(at[name], later[name]) for name in at}, "t,Cd,Cl")
    clock = ("--forces-clock", "log", "--overwrite")
    for table, zones in ((true, "+02:00"), (long, "+00:00 and +02:00")):
        line = f"begins in local time of an unknown zone; the times of the forces fit the zones {zones}:"
        assert f"drive.blf {line}" in place.call("--forces", table, *clock, log=log, status=1).err
        for zone in ("+02:00", "Europe/Helsinki"):
            place.call("--forces", table, *clock, "--log-zone", zone, log=log)
            same_forces(place.episode)
    # Forces of the hour that python-can meant, and of no other, show that it was UTC.
    write_forces(place.folder / "true.csv", later, "t,Cd,Cl")
    place.call("--forces", true, *clock, log=log)


def test_a_drive_at_another_speed_states_it_and_needs_no_setting(place):
    one = drive("fd", 200, 8)
    said = [speed("fd", k, 1000.0 + (k + 0.01) * 0.02, 20.0) for k in range(200)]
    log = write(place.folder / "slow.log", sorted([*log_of(one), *said], key=lambda message: message.timestamp))
    call = ("--forces", place.folder / "forces.csv")
    assert "give --set flow.control_period=0.16" in place.call(*call, log=log, status=1).err
    slow = (*call, "--set", "flow.control_period=0.16")
    assert "beyond the limit of 0.075: at 20 m/s the same jet flow" in place.call(*slow, log=log, status=1).err
    out = place.call(*slow, "--set", "flow.action_limit=0.08", log=log).out
    assert "slow.log: Cp is computed with the log's vehicle speed, 20 m/s" in out
    episode = place.episode
    np.testing.assert_allclose(episode.series["Cp"], one.Cp / 0.64, atol=CP_QUANTUM / 2)
    np.testing.assert_allclose(episode.series["t"], 0.16 * np.arange(200), atol=1e-9)
    # Forces in t_c of the vehicle's own speed.
    np.testing.assert_allclose(episode.series["Cd"], 1.0 + 0.1 * np.sin(0.16 * np.arange(200)), atol=1e-3)
