"""What is typed is what our codec reads; what the wire cannot carry is refused."""

import pytest

from can_bridge.tools.signals import PROTECTION, decode, encode
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import SPECS
from contract.errors import BusError
from tests.refused import refused

NAMES = [spec.name for spec in SPECS]


def test_what_is_typed_and_zeros_else_are_what_our_codec_reads():
    """That the codec reads every value as cantools writes it is `tests/can_bridge/wire/test_whole_range.py`'s."""
    typed = {"Valid0": 1, "Valid3": 1, "EnableRequest": 1, "Pressure0": -12.5, "Pressure3": 100.0, "Age": 1.25}
    for spec in SPECS:
        given = typed if spec.name.startswith("Pressure") and not spec.name.endswith("Classic") else {}
        found, content = encode(spec.name, [f"{one}={value}" for one, value in given.items()])
        assert (found, len(content)) == (spec, spec.protected)
        read = decode(Frame(frame_id=spec.frame_id, data=content.ljust(spec.length, b"\0"), is_fd=spec.is_fd))
        assert read is not None
        values = {one.name: one.value for one in read.signals if one.name not in PROTECTION}
        assert values == pytest.approx(dict.fromkeys(values, 0) | given), spec.name


def test_names_of_values_and_other_bases():
    for name, typed, same in (
        ("JetCommand", ["Mode=FAULT"], ["Mode=5"]),
        ("EcuStatus", ["BundleHash=0xd2ff969a"], ["BundleHash=3539965594"]),
        ("PressureClassic", ["Pressure2=INVALID"], ["Pressure2=-2048"]),
        ("VehicleSpeed", ["Speed=NOT_AVAILABLE", "AirDensity=NOT_KNOWN"], ["Speed=327.675"]),
    ):
        assert encode(name, typed) == encode(name, same) != encode(name, [])


def test_refused_in_one_line():
    for name, assignment, words in [
        ("Pressures", "", r"Pressures: is none of Pressure, .*VehicleSpeed, .*`python -m can.player`"),
        ("Pressure", "Pressure4=1", r"Pressure4=1: must be SIGNAL=VALUE with one of Valid0"),
        ("Pressure", "Pressure0", r"Pressure0: must be SIGNAL=VALUE"),
        ("Pressure", "E2E_CRC=1", "is filled in by the sender"),
        ("Pressure", "Pressure0=x", r"Pressure0=x: must be a number$"),
        ("Pressure", "Pressure0=nan", "Pressure cannot be sent"),
        ("Pressure", "Pressure0=3276.8", r"smaller than or equal to 3276.7"),
        ("Pressure", "Age=inf", "cannot be sent"),
        ("VehicleSpeed", "Pressure0=INVALID", "must be SIGNAL=VALUE with one of AirDensity"),
        ("JetCommand", "Mode=FAUL", "must be a number, or one of FAULT, DECAY"),
        ("JetCommand", "Mode=6", "smaller than or equal to 5"),
        ("JetCommand", "Mode=1.5", "must be a whole number"),
        ("EcuStatusClassic", "Missed=64", "smaller than or equal to 63"),
    ]:
        with refused(BusError, words) as caught:
            encode(name, [assignment] if assignment else [])
        assert "\n" not in str(caught.value), (name, assignment, words)
