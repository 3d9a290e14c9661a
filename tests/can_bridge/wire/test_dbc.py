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
    assert len(dbc.messages) == 12


def test_the_three_sets_have_the_same_signals_where_they_say_the_same():
    dbc = Database()
    dbc.add_dbc_string(TEXT)
    for name in ("Pressure", "VehicleSpeed", "JetCommand", "EcuStatus"):
        plain = {signal.name for signal in dbc.get_message_by_name(name).signals}
        secured = {signal.name for signal in dbc.get_message_by_name(f"{name}Secured").signals}
        classic = {signal.name for signal in dbc.get_message_by_name(f"{name}Classic").signals}
        assert secured - plain == {"Freshness", "MAC"}
        assert classic <= plain
