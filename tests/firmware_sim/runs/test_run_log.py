"""What a run keeps: its series on disk and as CSV, its metadata, its bus, and its recorded wake."""

import csv
import io
import json
import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from PIL import Image

from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import FD
from can_bridge.wire.messages import Mode, Reason
from contract import sensors
from contract.config.loading import load_config
from contract.config.vehicle import BusConfig
from contract.errors import StillwakeError
from contract.ledger import LEDGER_FIELDS
from contract.npz import read_npz
from contract.release import bundle
from ecu.calibrating import release_calibration
from firmware_sim.runs import run_log
from firmware_sim.runs.metadata import InjectedFault, RunEcu, RunMetadata
from firmware_sim.runs.run_log import COLUMNS, WALL, BusTotals, BusTraffic, Row, RunFolder, RunLog, WaitingTimes
from firmware_sim.runs.run_page.measurement import COLUMN_UNITS, write_csv
from firmware_sim.runs.wake_stills import MOST_STILLS, Scene, WakeRecorder, WakeStills, load, save
from wake.plant.sample import Sample

NAN = float("nan")
QUIET = BusTraffic(load=0.0, frames=0, error_frames=0, longest_wait_ms={}, nodes={})
MOUNTED = (39.0, 79.0, 80.0, 89.0)
"""Where the sensors of the metadata stand among the 90: upper 0 to 39, lower 40 to 79, base 80 to 89."""
CORE = RunEcu.of("mcu", 480.0, [10_000_000, 12_000_000, 11_000_000])
COMMAND = Frame(frame_id=FD.command.spec.frame_id, data=bytes(8))
PRESSURE = Frame(frame_id=FD.pressure.spec.frame_id, data=bytes(16))


def test_a_saved_run_is_read_back_to_the_bit(log_of, tmp_path):
    log, fault = log_of(command=[1.0, NAN, 1 / 3, 0.0, -0.0, 1e-300]), InjectedFault(text="noise:level=1", acted=3)
    others: Any = {"config": load_config(), "signer": "0123", "ecu": CORE, "faults": (fault,), "fault_seed": 7}
    log = replace(log, metadata=replace(log.metadata, **others))
    run_log.save(tmp_path / "a" / "series.npz", log)
    loaded = run_log.load(tmp_path / "a" / "series.npz")
    for name in ("bus", "enabled_at", "metadata", "traffic"):
        assert getattr(loaded, name) == getattr(log, name), name
    for name, values in log.series.items():
        np.testing.assert_array_equal(loaded.series[name], values)
    # An earlier version knew no other ECU than the one in Python.
    altered(tmp_path / "a" / "series.npz", lambda header: header["metadata"].pop("ecu"))
    assert run_log.load(tmp_path / "a" / "series.npz").metadata.ecu == RunEcu(kind="python")


def test_another_run_is_replaced_only_when_asked_and_a_file_is_no_folder(tmp_path):
    (tmp_path / "openfoam").mkdir()
    for left in (".run.json.lock", ".run.json.312.part"):  # of a killed process
        (tmp_path / left).touch()
    for free in (tmp_path, tmp_path / "new"):
        RunFolder(free).check_free(overwrite=False)
    for name in ("series.npz", "summary.json"):
        folder = tmp_path / name[:3]
        folder.mkdir()
        (folder / name).write_text("")
        with pytest.raises(StillwakeError, match="holds a run: give another folder, or --overwrite"):
            RunFolder(folder).check_free(overwrite=False)
        RunFolder(folder).check_free(overwrite=True)
        with pytest.raises(StillwakeError, match=rf"cannot write .*{name}: it is a file"):
            RunFolder(folder / name).check_free(overwrite=True)
        with pytest.raises(StillwakeError, match="holds files that no run wrote; give another folder"):
            RunFolder(tmp_path).check_free(overwrite=True)


def test_a_file_that_is_no_run_is_refused_by_name(tmp_path):
    path = tmp_path / "series.npz"
    with pytest.raises(StillwakeError, match=r"series\.npz: not the series of a run \(there is no such file\)$"):
        run_log.load(path)
    np.savez(path, header="{}", t=np.zeros(3))
    for content in (path.read_bytes(), b"", b"PK\x03\x04 nonsense", b"\x93NUMPY"):
        path.write_bytes(content)
        with pytest.raises(StillwakeError, match="not the series of a run"):
            run_log.load(path)


def altered(path, change, **others) -> None:
    arrays = dict(read_npz(path))
    header = json.loads(str(arrays.pop("header")))
    change(header)
    np.savez(path, header=json.dumps(header), **{**arrays, **others})


def test_what_no_run_holds_is_refused(log_of, tmp_path):
    path = tmp_path / "series.npz"
    run_log.save(path, log_of())
    altered(path, lambda header: (header.pop("schema"), header["metadata"]["versions"].update(stillwake="0.0.9")))
    with pytest.raises(StillwakeError, match=r"schema None, made by stillwake 0\.0\.9; .*reads 'stillwake-run/3'"):
        run_log.load(path)
    for change, named in (
        (lambda header: header["metadata"].pop("plant"), "plant"),
        (lambda header: header["metadata"].update(more=1), "more"),
        (lambda header: header["metadata"]["config"]["ecu"].update(hold_periods=-1), "hold_periods"),
        (lambda header: header["metadata"]["status"].update(state=99), "99"),
        # What JSON takes and no page could show.
        (lambda header: header["traffic"]["nodes"]["ECU"].update(bus_off=math.inf), "Infinity is not a number"),
        (lambda header: header.update(enabled_at="x"), "'x': must be a whole number"),
        (lambda header: header.update(enabled_at=7), "from 0 to 6"),
        (lambda header: header["metadata"].update(plant="\ud800"), "not text"),
        (lambda header: header["traffic"]["nodes"].update(ECU=[]), "must be a table"),
        ({"Cl": np.zeros(5)}, r"'Cl' is float64 of shape \(5,\): must be numbers of shape \(6\)"),
        ({"step_ms": np.full(6, math.inf)}, "'step_ms' is"),
        ({"t": np.zeros(6)}, "'t' must increase"),
        ({"Cd": np.full(6, NAN)}, "'Cd' must hold finite numbers"),
        ({"mode": np.full(6, 1.5)}, "values of Mode"),
        ({WALL: np.zeros((6, 3))}, r"must be numbers of shape \(6, 4\)"),
    ):
        run_log.save(path, log_of())
        if isinstance(change, dict):
            altered(path, lambda header: None, **change)
        else:
            altered(path, change)
        with pytest.raises(StillwakeError, match=rf"not the series of a run .*{named}"):
            run_log.load(path)


def test_a_row_becomes_one_value_in_every_column(run_metadata):
    entries = {name: float(k) for k, name in enumerate(LEDGER_FIELDS)}
    ecu: dict[str, Any] = {"command": 0.02, "predicted_Cd": 1.0, "predicted_Cl": 2.0, "step_ms": NAN, "age_ms": 8.0}
    cp = np.arange(sensors.COUNT, dtype=np.float64)
    samples = (Sample(**entries, t=t, Cp=cp + t, Uy_probe=-t, action=0.01 * t) for t in (1.0, 2.0))
    rows = [Row(sample=sample, mode=3, reason=1, **ecu) for sample in samples]
    log = RunLog.of(rows, 1, BusTotals(sent=0, lost=0, rejected=0), run_metadata, traffic=QUIET)
    assert tuple(log.series) == (*COLUMNS, WALL)
    # In the order of the bundle: upper_39, lower_39, base_0, base_9.
    assert log.series[WALL].tolist() == [[value + t for value in MOUNTED] for t in (1.0, 2.0)]
    # The base sensors are 80 to 89.
    assert log.series["base_Cp"].tolist() == [85.5, 86.5]
    for name, values in {"action": [0.01, 0.02], "mode": [3.0, 3.0], **{n: [v, v] for n, v in entries.items()}}.items():
        assert log.series[name].tolist() == values, name


def rows_of(path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def test_every_series_has_a_column_with_its_unit(shedding, tmp_path):
    log = shedding(modes={3: Mode.HOLD}, reasons={3: Reason.STREAM_LOST}, skipped=[4])
    log.series.update({WALL: np.arange(640.0).reshape(160, 4), **dict.fromkeys(run_log.WITHOUT, np.zeros(160))})
    write_csv(tmp_path / "a.csv", log)
    rows = rows_of(tmp_path / "a.csv")
    assert len(rows) == 160
    assert tuple(COLUMN_UNITS) == COLUMNS
    assert list(rows[0])[:3] == ["t [t_c]", "Cd [1]", "Cl [1]"]
    walls = [f"Cp_{name} [1]" for name in ("upper_39", "lower_39", "base_0", "base_9")]
    assert list(rows[0])[-7:] == [*(f"{name} [1]" for name in run_log.WITHOUT), *walls]
    assert (rows[63]["mode [name]"], rows[63]["reason [name]"]) == ("HOLD", "STREAM_LOST")
    assert (rows[64]["step_ms [ms]"], rows[65]["step_ms [ms]"]) == ("", "2")
    values = [float(rows[63][name]) for name in ("t [t_c]", "action [U_inf W]", "Cp_base_0 [1]")]
    assert values == [12.6, 0.05, 63 * 4 + 2]
    write_csv(tmp_path / "b.csv", shedding())
    assert len(rows_of(tmp_path / "b.csv")[0]) == len(COLUMNS)


def test_the_bundle_gives_name_sensors_and_settings_and_other_weights_are_named(random_release, run_metadata):
    release = bundle.load(random_release)
    own = release_calibration(release, run_metadata.config)
    weights = release.manifest.mpc.weights

    names = ("settle", "averages", "plant", "computed_by", "status", "origin")
    given = {name: getattr(run_metadata, name) for name in names}
    metadata = RunMetadata.of(release, run_metadata.config, calibration=own, **given)
    assert metadata.controller == f"random (int8, {release.digest[:12]})"
    assert (metadata.signer, metadata.changed_weights) == (None, {})
    assert {"python", "machine", "stillwake", "numpy"} <= set(metadata.versions)
    other = replace(own, weights=replace(weights, lift=9.0), action_limit=0.05)
    metadata = RunMetadata.of(release, run_metadata.config, calibration=other, **given)
    assert metadata.changed_weights == {"lift": (9.0, weights.lift)}
    assert metadata.mpc.weights == weights
    assert metadata.config.flow.action_limit == pytest.approx(0.05)


def test_an_emulated_core_has_median_and_longest_of_the_steps_that_planned():
    assert (CORE.modelled_ms, CORE.modelled_ms_max) == (11.0, 12.0)
    # Another ECU's compute time is a setting, and no figure of it.
    assert RunEcu.of("c", None, [8_000_000]) == RunEcu(kind="c")
    assert RunEcu.of("mcu", 480.0, []) == RunEcu(kind="mcu", clock_mhz=480.0)


def test_the_longest_wait_of_our_messages_is_kept():
    waits = WaitingTimes(messages=FD)
    bus = SimulatedBus(BusConfig(), observe=waits)
    one, other = bus.port(), bus.port()
    one.send(COMMAND)
    bus.advance_to(10**7)
    for _ in range(2):
        one.send(PRESSURE)
    other.send(COMMAND)
    another = Frame(frame_id=COMMAND.frame_id, data=b"", is_extended=True)  # its leading bits are zeros
    other.send(another)
    bus.advance_to(10**8)
    traffic = waits.traffic(bus.activity(), {})
    first_ns, pressure_ns = bus.frame_ns(another), bus.frame_ns(PRESSURE)
    assert traffic.longest_wait_ms == {
        "Pressure": (first_ns + pressure_ns) / 1e6,
        "JetCommand": (first_ns + 2 * pressure_ns) / 1e6,
    }
    assert (traffic.frames, traffic.error_frames) == (5, 0)
    assert traffic.load == bus.activity().load > 0


SCENE = Scene(view=(4.5, 16.5, -2.25, 2.25), size=(96, 36), sensors={"base_0": (7.5, 0.1), "base_1": (7.5, -0.1)})


def street(k: int) -> np.ndarray:
    x, y = np.meshgrid(np.arange(96.0), np.arange(36.0))
    total = np.zeros_like(x)
    for i in range(6):
        distance = (x - (12.0 + 16.0 * i + k) % 96.0) ** 2 + (y - (12.0 if i % 2 else 24.0)) ** 2
        total += (-1) ** i * 110.0 * np.exp(-distance / 30.0)
    return np.clip(np.rint(total), -127, 127).astype(np.int8)


def recorded(times: np.ndarray) -> WakeStills:
    recorder = WakeRecorder(SCENE, len(times))
    for k, t in enumerate(times):
        recorder.record(k, float(t), partial(street, k))
    return recorder.recorded()


def test_levels_come_back_within_the_loss_of_the_codec(log_of, tmp_path):
    log, path = log_of(), tmp_path / "wake.npz"
    save(path, recorded(log.series["t"]))
    loaded = load(path, log)
    assert (loaded.scene, loaded.k.tolist()) == (SCENE, list(range(6)))
    for k in range(6):
        error = loaded.levels(k).astype(int) - street(k)
        # A level is 1/127 of the scale: no one sees 2 % of it, and it has no sign.
        assert np.sqrt(np.mean(error**2)) < 3.0
        assert abs(np.mean(error)) < 0.5
        assert np.abs(error).max() < 25


def test_a_long_run_keeps_as_many_stills_evenly_spaced():
    recorder, asked = WakeRecorder(SCENE, 10 * MOST_STILLS + 1), list[int]()

    def levels(k: int) -> np.ndarray:
        asked.append(k)
        return np.zeros((36, 96), dtype=np.int8)

    for k in range(10 * MOST_STILLS + 1):
        recorder.record(k, 0.2 * k, partial(levels, k))
    wake = recorder.recorded()
    assert MOST_STILLS / 2 < len(wake.stills) <= MOST_STILLS
    assert set(np.diff(wake.k)) == {11}
    assert asked == wake.k.tolist()


def with_a_png(wake: WakeStills) -> WakeStills:
    buffer = io.BytesIO()
    Image.new("L", (96, 36)).save(buffer, format="PNG")
    return replace(wake, stills=(buffer.getvalue(), *wake.stills[1:]))


WRONG = {
    "not in the series": lambda wake: replace(wake, t=wake.t + 0.2),
    r"must increase and be in 0\.\.5": lambda wake: replace(wake, k=wake.k + 1),
    "stills must increase": lambda wake: replace(wake, k=wake.k[::-1]),
    r"6 stills for 5 periods": lambda wake: replace(wake, k=wake.k[:-1]),
    r"must have \(95, 36\)": lambda wake: replace(wake, scene=replace(wake.scene, size=(95, 36))),
    "not a WebP": with_a_png,
    "NaN is not a number": lambda wake: replace(wake, scene=replace(wake.scene, view=(0.0, 1.0, 0.0, float("nan")))),
}


def test_a_damaged_file_or_one_that_contradicts_the_run_is_refused(log_of, tmp_path):
    log = log_of()
    path, wake = tmp_path / "wake.npz", recorded(log.series["t"])
    for message, change in WRONG.items():
        save(path, change(wake))
        with pytest.raises(StillwakeError, match=rf"wake\.npz: not the recorded wake of this run \(.*{message}"):
            load(path, log)
    save(path, wake)
    whole = path.read_bytes()
    middle = len(whole) // 2
    for damaged in (whole[:-100], whole[:middle] + bytes([whole[middle] ^ 0xFF]) + whole[middle + 1 :], b""):
        path.write_bytes(damaged)
        with pytest.raises(StillwakeError, match="not the recorded wake of this run"):
            load(path, log)
