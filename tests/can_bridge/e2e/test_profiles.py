"""Where a protected message's CRC and counter stand, against the DBC as cantools reads it."""

from importlib.resources import files

import pytest
from cantools.database import Database

from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.sender import SenderState, protected_frame
from can_bridge.wire.message_specs import SPECS

DBC = Database()
DBC.add_dbc_string(files("contract").joinpath("stillwake.dbc").read_text())


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
def test_crc_and_counter_are_the_signals_of_the_dbc(spec):
    frame = protected_frame(SenderState(counter=11), bytes(spec.protected), spec=spec, now_ns=0)
    signals = DBC.decode_message(spec.name, frame.data.ljust(spec.length, b"\0"), decode_choices=False)
    assert isinstance(signals, dict)
    assert profile_of(spec).crc_of(frame.data) == signals["E2E_CRC"] != 0
    assert profile_of(spec).counter_of(frame.data) == signals["E2E_Counter"] == 11
