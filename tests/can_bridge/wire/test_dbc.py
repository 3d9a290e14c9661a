"""The DBC itself: what other tools must find in it without a warning."""

import warnings
from importlib.resources import files

from cantools.database import Database

TEXT = files("contract").joinpath("stillwake.dbc").read_text()


def test_cantools_reads_it_strictly_without_a_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        dbc = Database(strict=True)
        dbc.add_dbc_string(TEXT)
    assert len(dbc.messages) == 9


def test_writing_it_again_loses_nothing():
    """What cantools does not understand it does not write."""
    dbc, again = Database(), Database()
    dbc.add_dbc_string(TEXT)
    again.add_dbc_string(dbc.as_dbc_string())
    for message in dbc.messages:
        same = again.get_message_by_name(message.name)
        assert (same.frame_id, same.length, same.is_fd, same.comment, same.cycle_time) == (
            message.frame_id, message.length, message.is_fd, message.comment, message.cycle_time,
        )  # fmt: skip
        for signal in message.signals:
            other = same.get_signal_by_name(signal.name)
            assert (other.start, other.length, other.scale, other.unit, other.choices, other.comment) == (
                signal.start, signal.length, signal.scale, signal.unit, signal.choices, signal.comment,
            )  # fmt: skip


def test_the_three_sets_have_the_same_signals_where_they_say_the_same():
    dbc = Database()
    dbc.add_dbc_string(TEXT)
    for name in ("Pressure", "JetCommand", "EcuStatus"):
        plain = {signal.name for signal in dbc.get_message_by_name(name).signals}
        secured = {signal.name for signal in dbc.get_message_by_name(f"{name}Secured").signals}
        classic = {signal.name for signal in dbc.get_message_by_name(f"{name}Classic").signals}
        assert secured - plain == {"Freshness", "MAC"}
        assert classic <= plain
