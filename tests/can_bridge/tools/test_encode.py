"""What is typed is what cantools reads; what the wire cannot carry is refused."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

import contract
from can_bridge.tools.encode import NAMES, encode
from can_bridge.tools.signals import PROTECTION
from contract.errors import BusError
from tests.examples import examples
from tests.refused import refused

DATABASE: Any = cantools.database.load_file(Path(contract.__file__).parent / "stillwake.dbc")


def test_every_message_of_the_dbc_has_a_name_here():
    assert set(NAMES) == {one.name for one in DATABASE.messages}


@pytest.mark.parametrize("name", NAMES)
@examples(60)
@given(data=st.data())
def test_any_value_of_the_dbc_is_sent_as_cantools_reads_it(name, data):
    message = DATABASE.get_message_by_name(name)
    wanted = {}
    for signal in message.signals:
        if signal.name not in PROTECTION:
            low, high = round(signal.minimum / signal.scale), round(signal.maximum / signal.scale)
            wanted[signal.name] = data.draw(st.integers(low, high), label=signal.name) * signal.scale
    if wanted.get("PressureCounterValid") == 0:
        wanted["PressureCounter"] = 0
    spec, content = encode(name, [f"{one}={value!r}" for one, value in wanted.items()])
    assert (spec.name, len(content)) == (name, spec.protected)
    read = message.decode(content + bytes(spec.length - len(content)), decode_choices=False)
    assert {one: value for one, value in read.items() if one not in PROTECTION} == pytest.approx(wanted)


def test_names_of_values_and_other_bases():
    _, by_name = encode("JetCommand", ["Mode=FAULT"])
    assert by_name == encode("JetCommand", ["Mode=5"])[1]
    assert encode("EcuStatus", ["BundleHash=0xd2ff969a"])[1] == encode("EcuStatus", ["BundleHash=3539965594"])[1]
    assert encode("PressureClassic", ["Pressure2=INVALID"])[1] == encode("PressureClassic", ["Pressure2=-2048"])[1]
    by_name = encode("VehicleSpeed", ["Speed=NOT_AVAILABLE", "AirDensity=NOT_KNOWN"])[1]
    assert by_name == encode("VehicleSpeed", ["Speed=327.675"])[1] != encode("VehicleSpeed", [])[1]


def test_refused_in_one_line():
    for name, assignment, words in [
        ("Pressures", "", r"Pressures: is none of Pressure, VehicleSpeed, .*`python -m can.player`"),
        ("Pressure", "Pressure4=1", r"Pressure4=1: must be SIGNAL=VALUE with one of Valid0"),
        ("Pressure", "Pressure0", r"Pressure0: must be SIGNAL=VALUE"),
        ("Pressure", "E2E_CRC=1", "is filled in by the sender"),
        ("Pressure", "Pressure0=x", r"Pressure0=x: must be a number$"),
        ("Pressure", "Pressure0=nan", "must be finite"),
        ("Pressure", "Pressure0=3276.8", r"must be in -3276.8..3276.7"),
        ("Pressure", "Valid0=2", "must be 0 or 1"),
        ("Pressure", "Age=-1", "must be in 0..65535"),
        ("Pressure", "Age=inf", "cannot be sent"),
        ("PressureClassic", "Age=71", r"must be in 0..70 ms"),
        ("VehicleSpeedClassic", "Age=2551", r"must be in 0..2550 ms"),
        ("VehicleSpeed", "Speed=-1", r"must be in 0..327.67"),
        ("VehicleSpeed", "Pressure0=INVALID", "must be SIGNAL=VALUE with one of AirDensity"),
        ("JetCommand", "Mode=FAUL", "must be a number, or one of OFF, WARMUP"),
        ("JetCommand", "Mode=6", "6 is not a valid Mode"),
        ("JetCommand", "Mode=1.5", "must be a whole number"),
        ("JetCommand", "PressureCounter=3", "PressureCounter=3: the wire would carry 0"),
        # The codec itself lets counts of the classic set stay at their largest value.
        ("EcuStatusClassic", "Missed=64", "Missed=64: the wire would carry 63"),
        ("EcuStatusClassic", "Missed=-1", "must not be negative"),
    ]:
        with refused(BusError, words) as caught:
            encode(name, [assignment] if assignment else [])
        assert "\n" not in str(caught.value), (name, assignment, words)


@given(
    st.sampled_from(NAMES), st.lists(st.text(max_size=12) | st.from_regex(r"[A-Z][a-z]+[0-3]=[-0-9.e]+"), max_size=4)
)
@pytest.mark.slow
def test_nothing_typed_makes_it_fail_otherwise(name, assignments):
    with suppress(BusError):
        encode(name, assignments)
