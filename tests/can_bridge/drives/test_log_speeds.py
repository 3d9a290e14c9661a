"""The speed of the vehicle in a log makes its coefficients, and a log of two buses is read by channel."""

from dataclasses import replace

import can
import numpy as np
import pytest

from contract.config.operating_point import OperatingPoint
from contract.errors import DatasetError
from tests.can_bridge.drives import drive_log
from tests.can_bridge.drives.drive_log import PERIOD, SCALES, Drive, close, drive, in_time, log_of, read, same, speed
from tests.refused import refused


def with_speeds(one: Drive, speeds: list[float | None], *, density: float | None = None) -> list[can.Message]:
    """The drive's log with a VehicleSpeed behind every pressure."""
    said = [speed(one.kind, k, 1000.0 + (k + 0.01) * PERIOD, value, density) for k, value in enumerate(speeds)]
    return in_time([*log_of(one), *said])


def test_the_speed_in_the_log_makes_the_coefficients_and_contradictions_are_named() -> None:
    for kind in drive_log.KINDS:
        one = drive(kind, 60, 21)
        messages = with_speeds(one, [20.0] * 60, density=1.1)
        scales = replace(SCALES, period=0.16)
        (piece,) = read(messages, scales).pieces
        # q = 1.1 * 20^2 / 2 Pa, U W = 20 * 2.5 m2/s.
        close(piece.Cp, one.Cp * drive_log.PRESSURE / 220.0)
        close(piece.action, one.action * drive_log.FLOW / 50.0)
        period = r"20 ms apart, .* 20 m/s .*0\.16 W .*_period is 0\.2 .*25 m/s.*flow.control_period=0\.16"
        with refused(DatasetError, period):
            read(messages)
        given, state = frozenset({"operating_point.speed", "operating_point.density"}), "but its .* state"
        for point, text in (
            (OperatingPoint(density=1.1), rf"speed = 25 m/s, {state} 20 m/s"),
            (OperatingPoint(speed=20.0), rf"density = 1\.2 kg/m3, {state} 1\.1 kg"),
        ):
            with refused(DatasetError, text):
                read(messages, replace(scales, point=point, given=given))
        agreed = replace(scales, point=OperatingPoint(speed=20.1, density=1.1), given=given)
        assert read(messages, agreed).speed == (20.0, 20.0, 20.0)
    # A vehicle that does not know its speed: the operating point's.
    one = drive("fd", 60, 22)
    series = read(with_speeds(one, [None] * 60))
    same(series, one)
    assert series.speed is None


def test_rows_of_a_speed_that_varies_lie_at_equal_ways() -> None:
    """A drive from 20 to 30 m/s: what rises straight with the way travelled must do so in the rows."""
    rows = 300
    speeds = np.round(np.linspace(20.0, 30.0, rows) / 0.005) * 0.005
    way = np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2 * PERIOD / 2.5)])
    q, later = 0.6 * speeds**2, np.append(way[1:], way[-1] + 0.24)
    pressures = np.round((-0.5 + 0.01 * way[:, None] + 0.1 * np.arange(4)) * q[:, None] / 0.1) * 0.1
    # Jets reach the action of row k at row k + 1.
    flows = np.round(5e-4 * later * speeds * 2.5 / 2e-4) * 2e-4
    one = Drive("fd", pressures / drive_log.PRESSURE, flows / drive_log.FLOW)
    series = read(with_speeds(one, speeds.tolist()))
    (piece,) = series.pieces
    assert series.is_resampled
    place = 0.2 * (piece.first_row + np.arange(len(piece)))
    assert place[-1] == pytest.approx(way[-1], abs=0.25)
    # Steps of the wire: 0.05 Pa of 240 at least, and 1e-4 m2/s of 50; frames of the speed come 1 % of a period late.
    for i in range(4):
        np.testing.assert_allclose(piece.Cp[:, i], -0.5 + 0.01 * place + 0.1 * i, atol=0.05 / 240 + 1e-3)
    np.testing.assert_allclose(piece.action[:-1], 5e-4 * (place[:-1] + 0.2), atol=1e-4 / 50 + 2e-5)
    times = np.interp(place, way, 1000.0 + PERIOD * np.arange(rows))
    np.testing.assert_allclose(piece.time_s, times, atol=0.02 * PERIOD)
    assert piece.initial_action == pytest.approx(5e-4 * place[0], abs=1e-4 / 50 + 2e-5)


def test_jitter_is_no_other_clock_of_the_sender() -> None:
    """The median interval is wrong by up to 3 % here; the fitted period is not."""
    for seed in range(6):
        one, generator = drive("fd", 120, seed), np.random.default_rng(seed)
        messages = with_speeds(one, [25.0] * 120)
        for message in messages:
            message.timestamp += generator.uniform(0, 0.3) * PERIOD
        series = read(in_time(messages))
        same(series, one)
        assert abs(series.drift) < 1e-3


def test_rows_without_a_speed_are_gaps_and_jumps_are_not_believed() -> None:
    one = drive("fd", 120, 23)
    jumps: list[float | None] = [25.0] * 120
    jumps[0] = jumps[40] = jumps[41] = 60.0
    series = read(with_speeds(one, jumps))
    same(series, one)
    assert series.unused == {"with a repeated speed, or an impossible change of speed": 3}
    # 0.5 s is the oldest that is believed, on either side of a gap.
    silent: list[float | None] = [25.0] * 120
    silent[30:90] = [None] * 60
    stands: list[float | None] = [25.0] * 120
    for k in range(60):
        stands[30 + k] = max(0.0, 25.0 - 0.29 * 5 * min(k, 59 - k))
    for speeds, missing in ((silent, 11), (stands, 33)):
        with refused(DatasetError, r"no speed of a moving vehicle for \d+ control periods at .*--split"):
            read(with_speeds(one, speeds))
        series = read(with_speeds(one, speeds), split=True)
        assert len(series.pieces) == 2
        assert series.without_speed == pytest.approx(missing, abs=3)
        assert len([line for line in series.gaps if "speed of a moving vehicle" in line]) == 1
    # Before it drives off it stands for most of the log; or it never does.
    waits: list[float | None] = [max(0.0, 25.0 - 0.29 * 5 * max(0, 80 - k)) for k in range(120)]
    assert read(with_speeds(one, waits)).speed == (0.0, 25.0, 25.0)
    with refused(DatasetError, r"state 0 m/s: the vehicle stands"):
        read(with_speeds(one, [0.0] * 120))
    with refused(DatasetError, r"control period of 0\.2 W / U_inf, but flow.control_period is 2 "):
        read(with_speeds(one, [25.0] * 120), replace(SCALES, period=2.0))
    # A logger that stamps several periods with one time.
    coarse = with_speeds(one, [25.0] * 120)
    for message in coarse:
        message.timestamp -= message.timestamp % 0.1
    with refused(DatasetError, r"most pressure frames are not later than the one before"):
        read(coarse)


def test_a_log_of_two_buses_is_read_by_channel() -> None:
    one, other = drive("fd", 60, 24), drive("fd", 60, 25)
    ours, theirs = log_of(one), log_of(other)
    for messages, channel in ((ours, "can0"), (theirs, "can1")):
        for message in messages:
            message.channel = channel
    with refused(DatasetError, r"can0 \(60 Pressure, 60 JetCommand\) and can1 \(60 .*choose one with --channel"):
        read(in_time([*ours, *theirs]))
    # The same identifiers are another node's there; now and then its bytes have a right CRC.
    generator = np.random.default_rng(1)
    foreign = [drive_log.noise(message, generator) for message in theirs[4:]]
    series = read(in_time([*ours, *foreign, *theirs[:4]]))
    same(series, one)
    assert (series.channel, series.unused) == ("can0", {"on other channels": 120})
