"""A run in other programs: what mdfreader and an own reader of MCAP see is the run's own trace, value by value."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from can_bridge.wire.messages import Mode, Reason
from firmware_sim.runs import run_log, wake_stills
from firmware_sim.runs.run_log import RunFolder
from firmware_sim.runs.run_page.measurement import COLUMN_UNITS
from tests.can_bridge.tools.test_measurement import read_mcap

pytestmark = pytest.mark.usefixtures("no_pictures")


def series(log: run_log.RunLog) -> dict[str, tuple[Any, str]]:
    """Values and units of all that the group of a run has, as stored."""
    units = {name: (log.series[name], unit) for name, unit in COLUMN_UNITS.items()}
    wall = log.series[run_log.WALL].T
    return units | {f"Cp_{name}": (cp, "1") for name, cp in zip(log.metadata.sensors, wall, strict=True)}


def check_mdf(path: Path, log: run_log.RunLog) -> None:
    read = pytest.importorskip("mdfreader").Mdf(str(path))
    period_s = log.metadata.config.period_ns / 1e9
    begins = np.arange(len(log.series["t"])) * period_s
    for name, (values, unit) in series(log).items():
        found, words = read.get_channel_data(f"Run.{name}"), {"mode": Mode, "reason": Reason}.get(name)
        expected = [words(int(value)).name for value in values] if words else values
        np.testing.assert_array_equal(found, expected, name)
        assert read.get_channel_unit(f"Run.{name}") == {"1": "", "name": ""}.get(unit, unit), name
        np.testing.assert_allclose(read.get_channel_data(read.get_channel_master(f"Run.{name}")), begins, atol=1e-12)
    # On the bus: pressures to half a step of 0.1 Pa, but for the time with noise; commands to half a step of 2e-4 m2/s.
    point = log.metadata.config.operating_point
    quiet = (begins < 0.1) | (begins >= 0.2)
    for sensor in range(4):
        pressure = read.get_channel_data(f"Pressure.Pressure{sensor}")
        wanted = log.series[run_log.WALL][:, sensor] * point.dynamic_pressure
        np.testing.assert_allclose(pressure[quiet], wanted[quiet], rtol=0, atol=0.0500001)
    flow = read.get_channel_data("JetCommand.Flow")
    wanted = log.series["command"] * point.speed * point.width
    np.testing.assert_allclose(flow, wanted[: len(flow)], rtol=0, atol=1.00001e-4)
    assert read.get_channel_unit("JetCommand.Flow") == "m2/s"
    states = read.get_channel_data("EcuStatus.State")
    assert list(states) == [Mode(int(mode)).name for mode in log.series["mode"][: len(states)]]


def check_mcap(path: Path, log: run_log.RunLog, wake: wake_stills.WakeStills) -> None:
    found: dict[str, list[tuple[int, Any]]] = {}
    for topic, schema, time_ns, message in read_mcap(path):
        assert schema == {"/events": "foxglove.Log", "/wake": "foxglove.CompressedImage"}.get(topic, schema)
        found.setdefault(topic, []).append((time_ns, message))
    period_ns = log.metadata.config.period_ns
    assert [time_ns for time_ns, _ in found["/Run"]] == [k * period_ns for k in range(len(log.series["t"]))]
    for name, (values, unit) in series(log).items():
        field = name if unit in ("1", "name") else f"{name}_{unit.replace('/', '_per_').replace(' ', '_')}"
        np.testing.assert_array_equal([getattr(one, field) for _, one in found["/Run"]], values, name)
    happened = [(time_ns, one.timestamp.ToNanoseconds(), one.message) for time_ns, one in found["/events"]]
    requested = log.enabled_at * period_ns
    assert (requested, requested, "control is requested") in happened
    assert (100_000_000, 100_000_000, "disturbed by noise:level=0.2") in happened
    assert [time_ns for time_ns, _ in found["/wake"]] == [k * period_ns for k in wake.k]
    for index, (_, one) in enumerate(found["/wake"]):
        assert one.format == "jpeg"
        with Image.open(io.BytesIO(one.data)) as picture:
            assert picture.format == "JPEG"
            pixels = np.asarray(picture, dtype=int)
        # Vortices of one sense are red, those of the other blue.
        levels, red = wake.levels(index), pixels[..., 0] - pixels[..., 2]
        assert red[levels > 60].mean() > 60 and red[levels < -60].mean() < -60


@pytest.mark.slow  # a run of the loop
def test_a_run_is_its_own_trace_in_both_formats(printed, tmp_path, short_release, coarse):
    folder = tmp_path
    span = ("--lead-in", 1.2, "--controlled", 1.0, "--no-averages", "--disturb", "noise:level=0.2@0.1..0.2")
    printed("run", folder / "run", "--bundle", short_release, *span, *coarse.words, "--frames", folder / "run.mf4")
    printed("report", folder / "run", "--output", folder / "run.mcap")
    run = RunFolder(folder / "run")
    log = run_log.load(run.series)
    check_mdf(folder / "run.mf4", log)
    check_mcap(folder / "run.mcap", log, wake_stills.load(run.wake, log))
