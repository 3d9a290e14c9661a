"""A drive that is known comes out of its log again, whatever was lost, doubled, late or foreign in it."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.secoc.key import Key
from can_bridge.wire.message_sets import CLASSIC, FD
from can_bridge.wire.messages import Mode
from contract.errors import DatasetError
from tests.can_bridge.drives import drive_log
from tests.can_bridge.drives.drive_log import PERIOD, at, close, command, drive, in_time, log_of, pressure, read, same
from tests.examples import examples
from tests.refused import refused


@examples(30)
@given(data=st.data(), kind=st.sampled_from(drive_log.KINDS), seed=st.integers(0, 2**32 - 1))
def test_whatever_the_log_lost_or_added_the_rows_stay_the_drives(data: st.DataObject, kind: str, seed: int) -> None:
    """Jitter of 0.3 periods, up to two rows lost in a row, copies, other nodes' frames and damaged frames."""
    rows = data.draw(st.integers(40, 90))
    start = data.draw(st.sampled_from([0.0, 3.7, 1.7e9]))
    drift = data.draw(st.sampled_from([0.0, 1e-4, -1e-4]))
    one, generator = drive(kind, rows, seed % 1000), np.random.default_rng(seed)
    lost = {name: _lost(rows, data.draw(st.sets(st.integers(0, rows - 1), max_size=12))) for name in "pc"}
    messages = []
    for k in range(rows):
        begin = start + k * PERIOD * (1 + drift)
        for name, make, late in (("p", pressure, 0.0), ("c", command, drive_log.LATENCY)):
            if k in lost[name]:
                continue
            # A command is never in front of the pressure that it answers.
            at = begin + (late + generator.uniform(0, 0.3)) * PERIOD
            messages.append(make(one, k, at))
            if generator.random() < 0.1:
                messages.append(make(one, k, at + generator.uniform(0, 0.3) * PERIOD))
    copies = len(messages) - (2 * rows - sum(map(len, lost.values())))
    foreign = [_foreign(start + generator.uniform(0, rows * PERIOD), generator) for _ in range(20)]
    damaged = [_damaged(one, start + generator.uniform(0, rows * PERIOD), generator) for _ in range(3)]
    series = read(in_time([*messages, *foreign, *damaged]))

    whole = [k for k in range(rows) if k not in lost["p"] | lost["c"]]
    (piece,) = series.pieces
    # Without the action in force before it, a row can only be the one before the first; shut jets were shut before.
    first = next(k for k in whole if one.action[k] == 0.0 or (k > 0 and k - 1 not in lost["c"]))
    origin = min(k for k in range(rows) if k not in lost["p"])
    inside = np.arange(first, whole[-1] + 1)
    assert len(piece) == len(inside)
    assert piece.first_row == first - origin
    for values, found, name in ((one.Cp, piece.Cp, "p"), (one.action[:, None], piece.action[:, None], "c")):
        kept = np.array([k for k in range(rows) if k not in lost[name]])
        # The straight line between neighbours, which are the truth itself where nothing is lost.
        expected = np.column_stack([np.interp(inside, kept, column[kept]) for column in values.T])
        close(found, expected)
    unused = dict(series.unused)
    odd = sum(unused.pop(reason, 0) for reason in ("error frames", "remote frames", "of other messages"))
    assert (unused, odd) == ({"damaged": 3, **({"repeated": copies} if copies else {})}, 20)


def _lost(rows: int, wanted: set[int]) -> set[int]:
    """The wanted rows, but no more than two in a row: three are a long gap."""
    kept: set[int] = set()
    for k in sorted(wanted):
        if not {k - 1, k - 2} <= kept and k < rows:
            kept.add(k)
    return kept


def _foreign(time_s: float, generator: np.random.Generator) -> can.Message:
    kind = int(generator.integers(5))
    return can.Message(
        timestamp=time_s,
        arbitration_id=[0x123, 0x120, 0x140, 0x120, 0x130][kind],
        is_extended_id=kind == 1,
        is_remote_frame=kind == 3,
        is_error_frame=kind == 4,
        data=b"" if kind >= 3 else generator.bytes(8),
    )


def _damaged(one: drive_log.Drive, time_s: float, generator: np.random.Generator) -> can.Message:
    message = (pressure if generator.random() < 0.5 else command)(one, int(generator.integers(len(one.action))), time_s)
    place, protected = int(generator.integers(8)), message.data
    # One bit in the first eight bytes: both profiles find every single one.
    protected[place] ^= 1 << int(generator.integers(8))
    return message


def test_frames_are_put_in_their_order_by_counter_and_echo() -> None:
    one = drive("fd", 100, 2)
    messages = log_of(one)
    for k in (10, 50, 51, 80):
        messages[2 * k], messages[2 * k + 2] = messages[2 * k + 2], messages[2 * k]
    # A logger that writes late stamps late: the two share one time.
    for before, after in pairwise(messages):
        after.timestamp = max(after.timestamp, before.timestamp)
    messages.insert(140, pressure(one, 3, messages[139].timestamp))
    series = read(messages)
    same(series, one)
    assert series.unused == {"out of sequence": 1}
    # An ECU that takes 1.4 periods: every command comes after the next pressure.
    one = drive("classic", 100, 3)
    messages = [pressure(one, k, k * PERIOD) for k in range(100)]
    messages += [command(one, k, (k + 1.4) * PERIOD) for k in range(100) if k != 50]
    # It repeats its command for 49 where that for 50 would come.
    messages.append(command(one, 50, 51.4 * PERIOD, echo=49, mode=Mode.HOLD, action=one.action[50]))
    same(read(in_time(messages)), one)


def test_commands_that_do_not_answer_belong_to_the_period_they_came_in() -> None:
    one = drive("fd", 100, 4)
    messages = log_of(one)
    # The ECU missed pressure 40 and repeats its command for 39; at 60 the jets are not enabled, and so shut.
    messages[81] = command(one, 40, messages[81].timestamp, echo=39, mode=Mode.HOLD, action=one.action[39])
    messages[121] = command(one, 60, messages[121].timestamp, enable=False)
    # The command for 80 is lost, and repeated in 81: it is no answer to 80.
    messages[163] = command(one, 81, messages[163].timestamp, echo=80, mode=Mode.HOLD, action=one.action[80])
    del messages[161]
    assert one.action[60] != 0.0
    action = one.action.copy()
    action[40], action[60], action[81] = action[39], 0.0, action[80]
    action[80] = (action[79] + action[81]) / 2
    same(read(messages), replace(one, action=action))


def test_commands_for_the_next_period_are_the_actions_of_the_row_after() -> None:
    for kind in drive_log.KINDS:
        one = drive(kind, 60, 4)
        messages = []
        for k in range(60):
            messages.append(pressure(one, k, 5.0 + k * PERIOD))
            # At 30 the ECU holds: the command still rests on 29, came in 30 and is for 31.
            held: dict[str, Any] = {"echo": k - 1, "mode": Mode.HOLD} if k == 30 else {}
            action = float(one.action[min(k + 1, 59)])
            time_s = 5.0 + (k + drive_log.LATENCY) * PERIOD
            messages.append(command(one, k, time_s, action=action, next_period=True, **held))
        (piece,) = read(messages).pieces
        # What the jets did in the first period was asked for before the log begins.
        rows = piece.first_row + np.arange(len(piece))
        assert rows[0] <= 2, kind
        assert rows[-1] == 59, kind
        close(piece.action, one.action[rows])
        close(piece.Cp, one.Cp[rows])


def test_a_sensor_that_fails_for_a_moment_is_filled_alone() -> None:
    for kind in drive_log.KINDS:
        one = drive(kind, 60, 6)
        messages = log_of(one)
        messages[40] = pressure(one, 20, messages[40].timestamp, valid=(True, False, True, True))
        series = read(messages, sensors=("a", "b", "c", "d"))
        cp = one.Cp.copy()
        cp[20, 1] = (cp[19, 1] + cp[21, 1]) / 2
        same(series, replace(one, Cp=cp))
        assert series.filled == (1, 0)
        assert series.lost == (0, 0)
        assert "no valid pressure b for 1 control period at 0.400 s: filled" in series.gaps[0]


def test_age_and_drift_move_the_rows_and_another_period_is_refused() -> None:
    one = drive("fd", 60, 8)
    aged = [pressure(one, k, 5.0 + k * PERIOD, age_ms=3.0) for k in range(60)]
    (piece,) = read(in_time([*aged, *log_of(one, start_s=5.0)[1::2]])).pieces
    assert piece.time_s[0] == pytest.approx(4.997, abs=1e-9)
    one = drive("fd", 600, 12)
    series = read(log_of(one, period_s=PERIOD * (1 + 80e-6)))
    assert series.drift == pytest.approx(80e-6, abs=1e-9)
    same(series, one)
    for share, text in ((0.005, r"come every 20\.1 ms.*\+0\.50%"), (1.0, "40 ms apart"), (-0.5, "10 ms apart")):
        with pytest.raises(DatasetError, match=text):
            read(log_of(one, period_s=PERIOD * (1 + share)))


def test_authentication_is_checked_where_a_key_is_given() -> None:
    one = drive("secured", 60, 13)
    messages = log_of(one)
    messages[40].data[-1] ^= 1
    messages.insert(61, pressure(one, 3, messages[60].timestamp + 1e-4))
    series = read(messages, key=Key(drive_log.KEY))
    assert (series.unused, series.checked, series.filled) == ({"not authentic": 2}, True, (1, 0))
    assert read(messages).checked is False
    with pytest.raises(DatasetError, match=r"wrong authentication code: bus\.key is not the key"):
        read(messages, key=Key(bytes(range(16))))


def test_a_full_command_that_the_wire_rounded_up_is_the_limit_and_one_of_two_sets_can_be_asked_for() -> None:
    one, classic = drive("fd", 60, 14), drive("classic", 40, 17)
    limit = 0.0049996 / drive_log.FLOW  # 24.998 steps of the wire
    messages = log_of(replace(one, action=np.where(np.arange(60) % 2, 0.005 / drive_log.FLOW, 0.0)))
    (piece,) = read(messages, replace(drive_log.SCALES, action_limit=limit)).pieces
    assert piece.action.max() == limit
    both = in_time([*log_of(one), *log_of(classic)])
    same(read(both, only=FD), one)
    same(read(both, only=CLASSIC), classic)


def test_a_long_gap_or_a_sender_that_begins_again_is_refused_with_its_time_or_cuts_the_drive() -> None:
    """20 and 300 periods are more than the classic and the CAN FD counter can show by themselves. Without a gap, only
    counter and clock show that frames of two power cycles follow each other."""
    for kind in drive_log.KINDS:
        for missing in [20, 300]:
            one = drive(kind, 200 + missing, 9)
            messages = log_of(one, rows=[*range(100), *range(100 + missing, 200 + missing)])
            with refused(DatasetError, rf"no pressures for {missing} control periods at 2\.000 s.*--split"):
                read(messages)
            before, after = read(messages, split=True).pieces
            assert (before.first_row, len(before)) == (0, 100), (kind, missing)
            # The action before the second piece is not known: its first row serves as that.
            assert (after.first_row, len(after)) == (101 + missing, 99), (kind, missing)
            close(after.initial_action, one.action[100 + missing])
            close(after.Cp, one.Cp[101 + missing :])
            close(after.action, one.action[101 + missing :])
        one = drive(kind, 200, 10)
        for ahead in [1, 9]:
            messages = []
            for k in range(200):
                counter = k if k < 100 else k + ahead
                # The first frame of the second power cycle comes twice.
                messages += [pressure(one, k, k * PERIOD, counter=counter)] * (2 if k == 100 else 1)
                messages.append(command(one, k, (k + drive_log.LATENCY) * PERIOD, echo=counter))
            with refused(DatasetError, "the sender restarted"):
                read(messages)
            series = read(messages, split=True)
            assert [len(piece) for piece in series.pieces] == [100, 100], (kind, ahead)
            assert series.unused == {"repeated": 1}, (kind, ahead)
            close(series.pieces[1].Cp, one.Cp[100:])
            close(series.pieces[1].initial_action, one.action[99])


def test_what_makes_no_series_is_refused_in_one_line() -> None:
    one, classic = drive("fd", 40, 15), drive("classic", 40, 15)
    sound = log_of(one)
    foreign = [can.Message(arbitration_id=0x2A, is_extended_id=False, data=b"1", timestamp=1.0)]
    back = log_of(one)
    back[50].timestamp -= 1.0
    far = log_of(one)
    for message in far[40:]:
        message.timestamp += 1e9  # the logger's clock was set
    cases: list[tuple[list[can.Message], str]] = [
        ([], r"holds no pressure.*no data frame at all"),
        (foreign, r"holds no pressure, Pressure \(0x120\) or .*identifiers in it are 0x2a"),
        (sound[::2], r"holds no command, JetCommand \(0x130\).*the actions of the jets are unknown"),
        (sound[:6], "no part of it has 16 control periods.*3 pressures and 3 commands"),
        (in_time([*sound, *log_of(classic)]), "holds Pressure .* and PressureClassic"),
        (back, "times go back from 1000.488000 to 999.500000 s"),
        (far, "no pressures for about"),
        ([message for i, message in enumerate(sound) if i % 4], "no two pressure frames are consecutive"),
        (
            [pressure(one, k, k * PERIOD, valid=(True, True, True, False)) for k in range(40)] + sound[1:2],
            "16 control periods in a row with valid pressures.*; sensors that are never valid: 3",
        ),
    ]
    for messages, text in cases:
        with refused(DatasetError, text) as error:
            read(messages)
        assert str(error.value).startswith("drive.blf: ")
        assert "\n" not in str(error.value)


@examples(40)
@given(data=st.data(), kind=st.sampled_from(drive_log.KINDS), seed=st.integers(0, 2**32 - 1))
@pytest.mark.slow
def test_any_log_gives_whole_pieces_or_one_line(data: st.DataObject, kind: str, seed: int) -> None:
    """Cut, shuffled, restarted and damaged anywhere; what comes out holds rows of the drive, or is refused."""
    generator = np.random.default_rng(seed)
    one = drive(kind, 120, seed % 1000)
    messages = log_of(one, start_s=0.0)
    for what in data.draw(st.lists(st.integers(0, 6), max_size=6)):
        if not messages:
            break
        a, b = sorted(generator.integers(0, len(messages), 2).tolist())
        begun, jump = messages[a].timestamp, generator.choice([0.01, 0.5, 30.0, 1e9])
        head, middle, tail = messages[:a], messages[a:b], messages[b:]
        messages = [
            [*head, *tail],
            [*head, *(at(message, message.timestamp + jump) for message in messages[a:])],
            [*head, *middle[::-1], *tail],
            [*head, *(drive_log.noise(message, generator) for message in middle), *tail],
            [*head, pressure(one, 5, begun, valid=(False, True, True, True)), *messages[a + 1 :]],
            [*head, *middle, *(at(message, messages[b].timestamp) for message in messages[a : a + 3]), *tail],
            [*head, *(at(message, message.timestamp - begun) for message in messages[a:])],
        ][what]
    try:
        series = read(messages, split=bool(seed % 2), fill=seed % 5)
    except DatasetError as error:
        assert "\n" not in str(error)
        return
    assert series.pieces
    for piece in series.pieces:
        assert len(piece) >= 16
        assert piece.Cp.shape == (len(piece), 4)
        assert np.isfinite(piece.Cp).all()
        assert np.isfinite(piece.action).all()
        assert np.isfinite(piece.initial_action)
        # Filled or not, a row lies between rows of the drive.
        assert (one.Cp.min(axis=0) - drive_log.EXACT <= piece.Cp).all()
        assert (piece.Cp <= one.Cp.max(axis=0) + drive_log.EXACT).all()
        # Double precision has steps of 0.12 us behind 1e9 s.
        assert np.diff(piece.time_s) == pytest.approx(series.period_s, abs=5e-7)
