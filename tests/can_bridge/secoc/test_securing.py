import shutil
import subprocess

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.e2e.profiles import PROFILE_5
from can_bridge.secoc.securing import LARGEST_HALF, Freshness, secure, verify
from can_bridge.wire.frame import FD_LENGTHS, Frame
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE_SECURED, SPECS
from tests.can_bridge.secoc.conftest import SECRET
from tests.refused import refused

SECURED = [spec for spec in SPECS if spec.is_secured]


@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl")
def test_layout_and_mac_are_openssls(genuine):
    """Put together here from the DBC's words, and the MAC computed by another program."""
    for spec in SECURED:
        frame = genuine(spec, trip=0x01020304, count=0x05060708)
        length = {"PressureSecured": 32, "EcuStatusSecured": 48}.get(spec.name, 24)
        zeros = 8 if spec.name == "EcuStatusSecured" else 0
        content = PROFILE_5.protect(bytes([0x5A] * spec.protected), data_id=spec.data_id, counter=0x08)
        covered = content + bytes(zeros) + bytes.fromhex("0102030405060708")
        answer = subprocess.run(
            ["openssl", "mac", "-cipher", "AES-128-CBC", "-macopt", f"hexkey:{SECRET.hex()}", "CMAC"],
            input=spec.data_id.to_bytes(2, "big") + covered,
            capture_output=True,
            check=True,
        )
        mac = bytes.fromhex(answer.stdout.decode().strip())
        assert len(frame.data) == length, spec
        assert frame.data == covered + mac[:8], spec


def test_what_is_secured_verifies_with_its_freshness_and_without_a_flipped_bit(genuine, key):
    for spec in SECURED:
        frame = genuine(spec, trip=7, count=9)
        assert verify(frame.data, spec, key) == 7 << 32 | 9, spec
        assert (frame.frame_id, frame.is_fd, frame.timestamp_ns) == (spec.frame_id, True, 9), spec
        word = int.from_bytes(frame.data, "big")
        for bit in range(8 * spec.length):
            assert verify((word ^ 1 << bit).to_bytes(spec.length, "big"), spec, key) is None, bit


def test_frame_of_one_message_is_none_of_another(genuine, key):
    """Reflected under another identifier, cut or filled up to its length."""
    for sent in SECURED:
        data = genuine(sent).data
        for claimed in SECURED:
            for changed in (data[: claimed.length], data.ljust(claimed.length, b"\0"), data[-claimed.length :]):
                assert (verify(changed, claimed, key) is not None) == (sent is claimed)


@given(data=st.binary(max_size=64), spec=st.sampled_from(SECURED))
def test_any_bytes_are_refused_without_raising(data, spec, key):
    assert verify(data, spec, key) is None


def test_only_the_protected_part_of_a_secured_message_is_secured(key):
    with pytest.raises(ValueError, match="JetCommand: has no room"):
        secure(Frame(frame_id=JET_COMMAND.frame_id, data=bytes(8)), JET_COMMAND, key, Freshness())
    for length in (item for item in FD_LENGTHS if item != PRESSURE_SECURED.protected):
        with pytest.raises(ValueError, match=f"PressureSecured of {length} bytes: must have 16"):
            secure(Frame(frame_id=PRESSURE_SECURED.frame_id, data=bytes(length)), PRESSURE_SECURED, key, Freshness())


def test_freshness_counts_up_over_frames_and_trips():
    last = Freshness(trip=1, count=LARGEST_HALF)
    greatest = Freshness(trip=LARGEST_HALF, count=LARGEST_HALF)
    assert [item.value - (1 << 32) for item in (Freshness(), Freshness().next())] == [0, 1]
    assert [item.value for item in (last, Freshness(trip=2), greatest)] == [(2 << 32) - 1, 2 << 32, (1 << 64) - 1]
    # At its end it stays: a carry would use up values of the next power cycle.
    assert last.next() == last
    for halves in ({"trip": 0}, {"trip": 1 << 32}, {"count": -1}, {"count": 1 << 32}):
        with refused(ValueError, "must be in"):
            Freshness(**halves)
