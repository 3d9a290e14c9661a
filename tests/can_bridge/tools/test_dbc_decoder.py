import sys
from pathlib import Path

import pytest

import contract
from can_bridge.tools import signals
from can_bridge.tools.dbc_decoder import decoder_of
from can_bridge.wire.frame import Frame
from contract.errors import BusError

OTHER = """VERSION ""
NS_ :
BS_:
BU_: A
BO_ 288 Engine: 8 A
 SG_ Speed : 0|16@1+ (0.25,0) [0|0] "rpm" A
 SG_ Gear : 16|4@1+ (1,0) [0|0] "" A
BO_ 2147483904 Wide: 2 A
 SG_ Level : 7|16@0- (1,-40) [0|0] "degC" A
BO_ 512 Multi: 2 A
 SG_ Which M : 0|8@1+ (1,0) [0|0] "" A
 SG_ First m0 : 8|8@1+ (1,0) [0|0] "" A
 SG_ Second m1 : 8|8@1+ (2,0) [0|0] "" A
VAL_ 288 Gear 0 "NEUTRAL" 1 "FIRST" ;
"""


@pytest.fixture
def other(tmp_path: Path) -> Path:
    path = tmp_path / "other.dbc"
    path.write_text(OTHER)
    return path


def shown(decoded):
    assert decoded is not None
    return {one.name: one.shown + (f" {one.unit}" if one.unit else "") for one in decoded.signals}


def test_another_file_gives_values_units_and_names_of_values(other):
    decode = decoder_of(other)
    got = decode(Frame(frame_id=288, data=bytes([0x10, 0x27, 1, 0, 0, 0, 0, 0]), is_fd=False))
    assert got is not None
    assert (got.name, got.spec) == ("Engine", None)
    # 0x2710 = 10000 quarters.
    assert shown(got) == {"Speed": "2500 rpm", "Gear": "FIRST"}
    for frame_id, data, is_extended, expected in [
        (256, b"\xff\xfe", True, {"Level": "-42 degC"}),
        # Multiplexed; no signal goes with 2: nothing can be read.
        (512, b"\x01\x05", False, {"Which": "1", "Second": "10"}),
        (512, b"\x02\x05", False, {}),
    ]:
        frame = Frame(frame_id=frame_id, data=data, is_fd=False, is_extended=is_extended)
        assert shown(decode(frame)) == expected
    assert decode(Frame(frame_id=256, data=b"\xff\xfe", is_fd=False)) is None


def test_our_messages_stay_known_and_keep_their_check(other):
    decode = decoder_of(other)
    command = Frame(frame_id=0x130, data=bytes(8))
    assert decode(command) == signals.decode(command)
    ours = decoder_of(Path(contract.__file__).parent / "stillwake.dbc")(command)
    assert ours is not None
    assert ours.spec is not None


def test_without_cantools_the_error_names_what_to_install(other, monkeypatch):
    monkeypatch.setitem(sys.modules, "cantools.database", None)
    with pytest.raises(BusError, match=r"other\.dbc: reading it needs cantools: pip install '\.\[bus\]' in a checkout"):
        decoder_of(other)
    assert decoder_of(None) is signals.decode
