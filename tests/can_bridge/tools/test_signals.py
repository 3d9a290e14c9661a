"""Our own codec against cantools, for every message of the DBC."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.tools.signals import PROTECTION, Decoded, decode, encode
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import PRESSURE, SPECS
from contract.errors import BusError
from tests.can_bridge.wire.described import DBC
from tests.examples import examples
from tests.refused import refused


def read(frame_id: int, data: bytes, *, is_fd: bool = True) -> Decoded:
    found = decode(Frame(frame_id=frame_id, data=data, is_fd=is_fd))
    assert found is not None
    return found


@examples(100)
@given(spec=st.sampled_from(SPECS), data=st.data())
def test_any_bytes_mean_what_cantools_says(spec, data):
    content = data.draw(st.binary(min_size=spec.length, max_size=spec.length))
    message: Any = DBC.get_message_by_frame_id(spec.frame_id)
    raw = message.decode(content, decode_choices=False)
    got = read(spec.frame_id, content, is_fd=spec.is_fd)
    assert (got.spec.name, got.spec) == (message.name, spec)
    tables = {one.name: one.choices for one in message.signals if one.name in ("Mode", "State", "Reason")}
    if any(raw[name] not in table for name, table in tables.items()):
        assert got.signals == ()
        return
    if raw.get("PressureCounterValid") == 0:
        # It means nothing then, and our codec drops it.
        raw["PressureCounter"] = 0
    # A double carries sixteen digits of the two 64-bit numbers; ours are whole.
    assert {one.name: one.value for one in got.signals} == pytest.approx(raw, rel=1e-12, abs=0)
    assert {one.name: one.unit for one in got.signals} == {one.name: one.unit or "" for one in message.signals}
    for one in got.signals:
        if one.name in ("BundleHash", "MAC"):
            # As a digest has it: two hexadecimal digits a byte.
            digits = message.get_signal_by_name(one.name).length // 4
            assert one.shown == "0x" + format(raw[one.name], "x").rjust(digits, "0")
            continue
        if isinstance(raw[one.name], int) and not one.text:
            assert int(one.shown) == raw[one.name]
        choice = (message.get_signal_by_name(one.name).choices or {}).get(raw[one.name])
        assert one.text == ("" if choice is None else str(choice))


def test_others_are_unknown_a_wrong_length_is_unreadable_and_no_digits_are_shown_that_the_wire_does_not_carry():
    for frame in (Frame(frame_id=0x7FF, data=bytes(8)), Frame(frame_id=0x120, data=bytes(16), is_extended=True)):
        assert decode(frame) is None, frame
    for length in [0, 8, 12, 20]:
        assert read(0x120, bytes(length)) == (PRESSURE, ()), length
    shown = {one.name: one.shown for one in read(0x130, bytes([0, 0, 0, 2, 3, 0, 0, 0])).signals}
    # 3 * 0.0002 in doubles is 0.0006000000000000001.
    assert (shown["Flow"], shown["Mode"]) == ("0.0006", "CONTROL")
    signals = read(0x121, bytes([0, 0, 0, 8, 0, 0, 0, 0]), is_fd=False).signals
    assert [one.shown for one in signals if one.unit == "Pa"] == ["INVALID", "0", "0", "0"]


def test_what_is_typed_and_zeros_else_are_what_our_codec_reads():
    """That the codec reads every value as cantools writes it is `tests/can_bridge/wire/test_codec.py`'s."""
    typed = {"Valid0": 1, "Valid3": 1, "EnableRequest": 1, "Pressure0": -12.5, "Pressure3": 100.0, "Age": 1.25}
    for spec in SPECS:
        given = typed if spec.name.startswith("Pressure") and not spec.name.endswith("Classic") else {}
        found, content = encode(spec.name, [f"{one}={value}" for one, value in given.items()])
        assert (found, len(content)) == (spec, spec.protected)
        signals = read(spec.frame_id, content.ljust(spec.length, b"\0"), is_fd=spec.is_fd).signals
        values = {one.name: one.value for one in signals if one.name not in PROTECTION}
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
        ("Pressures", "", r"Pressures: must be one of Pressure, .*VehicleSpeed, .*`python -m can.player`"),
        ("Pressure", "Pressure4=1", r"Pressure4=1: must be SIGNAL=VALUE; signals: Valid0"),
        ("Pressure", "Pressure0", r"Pressure0: must be SIGNAL=VALUE"),
        ("Pressure", "E2E_CRC=1", "is filled in by the sender"),
        ("Pressure", "Pressure0=x", r"Pressure0=x: must be a number$"),
        ("Pressure", "Pressure0=nan", "Pressure cannot be sent"),
        ("Pressure", "Pressure0=3276.8", r"smaller than or equal to 3276.7"),
        ("JetCommand", "Mode=FAUL", "must be a number, or one of FAULT, DECAY"),
        ("JetCommand", "Mode=1.5", "must be a whole number"),
    ]:
        with refused(BusError, words) as caught:
            encode(name, [assignment] if assignment else [])
        assert "\n" not in str(caught.value), (name, assignment, words)
    with refused(BusError, "Age=2: Age is given twice"):
        encode("Pressure", ["Age=1", "Age=2"])
