"""Where a log is cut in two, or refused: a gap, a sender that began again, nothing to make a series of."""

import can
import numpy as np
import pytest

from contract.errors import DatasetError
from tests.can_bridge.drives.drive_log import LATENCY, PERIOD, command, drive, log_of, pressure
from tests.can_bridge.drives.drive_series import EXACT, KINDS, read, same
from tests.refused import refused


def test_a_long_gap_is_refused_with_its_time_or_cuts_the_drive_in_two() -> None:
    """20 and 300 periods are more than the classic and the CAN FD counter can tell by themselves."""
    for kind in KINDS:
        for missing in [3, 20, 300]:
            one = drive(kind, 200 + missing, 9)
            messages = [message for i, message in enumerate(log_of(one)) if not 200 <= i < 200 + 2 * missing]
            with pytest.raises(
                DatasetError, match=rf"no pressures for {missing} control periods at 2\.000 s.*--split"
            ) as error:
                read(messages)
            assert "\n" not in str(error.value), (kind, missing)
            series = read(messages, split=True)
            before, after = series.pieces
            assert (before.first_row, len(before)) == (0, 100), (kind, missing)
            # The action before the second piece is not known: its first row serves as that.
            assert (after.first_row, len(after)) == (101 + missing, 99), (kind, missing)
            assert after.initial_action == pytest.approx(one.action[100 + missing], abs=EXACT), (kind, missing)
            np.testing.assert_allclose(after.Cp, one.Cp[101 + missing :], atol=EXACT)
            np.testing.assert_allclose(after.action, one.action[101 + missing :], atol=EXACT)
            same(read(messages[:200]), one)


def test_a_sender_that_begins_again_cuts_the_drive() -> None:
    """Without a gap: only counter and clock tell that frames of two power cycles follow each other."""
    for kind in KINDS:
        for ahead in [1, 5, 9]:
            one = drive(kind, 200, 10)
            messages = []
            for k in range(200):
                counter = k if k < 100 else k + ahead
                messages.append(pressure(one, k, k * PERIOD, counter=counter))
                messages.append(command(one, k, (k + LATENCY) * PERIOD, echo=counter))
            with refused(DatasetError, "the sender began again"):
                read(messages)
            series = read(messages, split=True)
            assert [len(piece) for piece in series.pieces] == [100, 100], (kind, ahead)
            np.testing.assert_allclose(series.pieces[1].Cp, one.Cp[100:], atol=EXACT)
            assert series.pieces[1].initial_action == pytest.approx(one.action[99], abs=EXACT), (kind, ahead)


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
        (sound[::2], r"holds no command, JetCommand \(0x130\).*what the jets did"),
        (sound[:6], "no part of it has 16 control periods.*3 pressures and 3 commands"),
        (sorted([*sound, *log_of(classic)], key=lambda m: m.timestamp), "holds Pressure .* and PressureClassic"),
        (back, "times go back from 1000.488000 to 999.500000 s"),
        (far, "no pressures for about"),
        ([message for i, message in enumerate(sound) if i % 4], "no two of its pressures follow each other"),
        (
            [pressure(one, k, k * PERIOD, valid=(True, True, True, False)) for k in range(40)] + sound[1:2],
            "16 control periods in a row with valid pressures.*, and 3 valid in none",
        ),
    ]
    for messages, text in cases:
        with pytest.raises(DatasetError, match=text) as error:
            read(messages)
        assert str(error.value).startswith("drive.blf: ")
        assert "\n" not in str(error.value)
