"""Frames secured and verified: the layout by another program, what is refused, and what outlives a power cycle."""

import json
import os
import shutil
import subprocess
from dataclasses import replace

import pytest

from can_bridge.e2e.profiles import PROFILE_5, SenderState, protected_frame
from can_bridge.secoc import securing
from can_bridge.secoc.freshness_store import FRESHNESS_SCHEMA, FreshnessStore
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import LARGEST_HALF, Authentication, Freshness, VerifierState, secure, verified, verify
from can_bridge.wire.frame import FD_LENGTHS, Frame
from can_bridge.wire.message_specs import JET_COMMAND, JET_COMMAND_SECURED, PRESSURE, SECURED_SPECS, MessageSpec
from contract.config.vehicle import BusConfig
from contract.errors import BusError, ConfigError, StillwakeError
from tests.refused import refused

SPEC = SECURED_SPECS[0]
SECRET = bytes(range(0x10, 0x20))
KEY = Key(SECRET)


def genuine(spec: MessageSpec, *, trip: int = 1, count: int = 0, content: int = 0x5A, by: Key = KEY) -> Frame:
    bare = protected_frame(SenderState(counter=count % 256), bytes([content] * spec.protected), spec=spec, now_ns=count)
    return secure(bare, spec, by, Freshness(trip=trip, count=count))


@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl")
def test_layout_and_mac_are_openssls():
    """Put together here from the DBC's words, and the MAC computed by another program."""
    for spec in SECURED_SPECS:
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


def test_what_is_secured_verifies_with_its_freshness_and_without_a_flipped_bit():
    for spec in SECURED_SPECS:
        frame = genuine(spec, trip=7, count=9)
        assert verify(frame.data, spec, KEY) == 7 << 32 | 9, spec
        assert (frame.frame_id, frame.is_fd, frame.timestamp_ns) == (spec.frame_id, True, 9), spec
        word = int.from_bytes(frame.data, "big")
        for bit in range(8 * spec.length):
            assert verify((word ^ 1 << bit).to_bytes(spec.length, "big"), spec, KEY) is None, bit
    # Nor is a frame of one message, reflected under another's identifier, cut or filled up to its length, another's.
    for sent in SECURED_SPECS:
        data = genuine(sent).data
        for claimed in SECURED_SPECS:
            for changed in (data[: claimed.length], data.ljust(claimed.length, b"\0"), data[-claimed.length :]):
                assert (verify(changed, claimed, KEY) is not None) == (sent is claimed)
    assert not any(verify(bytes(length), spec, KEY) for spec in SECURED_SPECS for length in range(65))


def test_only_the_protected_part_of_a_secured_message_is_secured():
    with pytest.raises(ValueError, match="JetCommand has no room"):
        secure(Frame(frame_id=JET_COMMAND.frame_id, data=bytes(8)), JET_COMMAND, KEY, Freshness())
    for length in (item for item in FD_LENGTHS if item != SPEC.protected):
        with pytest.raises(ValueError, match=f"PressureSecured has {length} bytes: must have 16"):
            secure(Frame(frame_id=SPEC.frame_id, data=bytes(length)), SPEC, KEY, Freshness())


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


def forged(frame: Frame) -> Frame:
    return replace(frame, data=frame.data[:-1] + bytes([frame.data[-1] ^ 1]))


def test_only_a_greater_freshness_is_fresh():
    before = VerifierState(freshness=2 << 32 | 100)
    stale, fresh = [(2, 100), (2, 99), (1, 101)], [(2, 101), (2, 5000), (3, 0), (1 << 31, 0)]
    for trip, count in stale + fresh:
        passes = (trip, count) in fresh
        frame = genuine(SPEC, trip=trip, count=count)
        judged = verified(before, [frame], spec=SPEC, key=KEY)
        assert list(judged.frames) == ([frame] if passes else []), (trip, count)
        assert judged.none_authentic is not passes, (trip, count)
        assert (judged.state.not_fresh, judged.state.not_authentic) == (not passes, 0), (trip, count)


def test_forged_repeated_and_reflected_frames_are_dropped_and_counted_apart():
    real = [genuine(SPEC, count=count) for count in (0, 1)]
    reflected = replace(genuine(JET_COMMAND_SECURED, count=9), frame_id=SPEC.frame_id)
    strange = genuine(SPEC, count=9, by=Key(SECRET[::-1]))
    frames = [forged(real[1]), real[0], real[0], reflected, real[1], strange, real[0]]
    found = verified(VerifierState(), frames, spec=SPEC, key=KEY)
    assert list(found.frames) == real
    assert (found.state.not_authentic, found.state.not_fresh, found.state.refused) == (3, 2, 5)
    assert not found.none_authentic


def test_frames_of_other_messages_silence_and_no_key_change_nothing():
    before = VerifierState(freshness=9, not_authentic=4, not_fresh=5)
    others = [genuine(JET_COMMAND_SECURED), Frame(frame_id=0x7FF, data=b""), replace(genuine(SPEC), is_extended=True)]
    for frames in (others, []):
        assert verified(before, frames, spec=SPEC, key=KEY) == (before, frames, False)
    plain = [Frame(frame_id=PRESSURE.frame_id, data=bytes(16))]
    assert verified(before, plain, spec=PRESSURE, key=None) == (before, plain, False)


def test_settings_and_key_must_agree():
    """A node that is to authenticate never goes on without."""
    authentication = Authentication(key=KEY)
    assert securing.key_of(authentication, BusConfig(key="file")) is KEY
    assert securing.key_of(None, BusConfig()) is None
    with pytest.raises(ConfigError, match=r"bus\.key = 'file': the node was made without a key"):
        securing.key_of(None, BusConfig(key="file"))
    for plain in (BusConfig(), BusConfig(frames="classic")):
        with pytest.raises(ConfigError, match="the node was made with a key"):
            securing.key_of(authentication, plain)
    frame = Frame(frame_id=JET_COMMAND.frame_id, data=bytes(8))
    assert securing.secured(frame, spec=JET_COMMAND, key=None, freshness=authentication.freshness) is frame


def test_every_start_is_another_power_cycle_counted_before_it_is_used(tmp_path, monkeypatch):
    """When the count cannot be written, there is no authentication with which to send."""
    assert [FreshnessStore(tmp_path / "node").begin(KEY).trip for _ in range(4)] == [1, 2, 3, 4]
    assert [path.name for path in tmp_path.iterdir()] == ["node"]

    def fails(*arguments: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fails)
    with pytest.raises(StillwakeError, match="No space left"):
        FreshnessStore(tmp_path / "node").begin(KEY)
    monkeypatch.undo()
    assert json.loads((tmp_path / "node").read_text())["trip"] == 4


def test_what_was_accepted_is_refused_after_a_restart(tmp_path):
    store = FreshnessStore(tmp_path / "ecu", every=50)
    state = store.begin(KEY).verifier(SPEC)
    recorded = [genuine(SPEC, trip=3, count=count) for count in range(120)]
    for frame in recorded:
        state = verified(state, [frame], spec=SPEC, key=KEY).state
        store.accepted(SPEC.frame_id, state.freshness)
    older = genuine(SPEC, trip=2, count=10**6)

    again = FreshnessStore(tmp_path / "ecu").begin(KEY)
    state = again.verifier(SPEC)
    assert (again.trip, again.freshness) == (2, Freshness(trip=2))
    replayed = verified(state, [older, *recorded], spec=SPEC, key=KEY)
    # What stays open: the frames since the last write, fewer than 50.
    passed = [frame.timestamp_ns for frame in replayed.frames]
    assert passed == list(range(101, 120))
    # After the first genuine frame nothing recorded passes.
    state = verified(state, [genuine(SPEC, trip=3, count=120)], spec=SPEC, key=KEY).state
    assert not verified(state, [older, *recorded], spec=SPEC, key=KEY).frames


def test_another_power_cycle_of_the_sender_is_kept_at_once(tmp_path):
    store = FreshnessStore(tmp_path / "ecu", every=10**6)
    store.begin(KEY)
    store.accepted(SPEC.frame_id, Freshness(trip=8).value)
    state = FreshnessStore(tmp_path / "ecu").begin(KEY).verifier(SPEC)
    assert not verified(state, [genuine(SPEC, trip=7, count=LARGEST_HALF)], spec=SPEC, key=KEY).frames
    assert verified(state, [genuine(SPEC, trip=8, count=1)], spec=SPEC, key=KEY).frames


def test_a_damaged_file_is_refused_and_kept(tmp_path):
    """Counting from 1 again in silence would use values twice."""
    fields = [
        *('"trip": -1, "heard": {}', '"trip": true, "heard": {}', '"trip": 1.5, "heard": {}', '"trip": 1, "heard": []'),
        *('"trip": 1, "heard": {"x": 1}', '"trip": 1, "heard": {"290": 18446744073709551616}'),
    ]
    bodies = [f'{{"schema": "{FRESHNESS_SCHEMA}", {each}}}' for each in fields]
    other = '{"schema": "stillwake-freshness/2", "trip": 1, "heard": {}}'
    for content in ("", "null", "[]", "{}", other, *bodies, "[" * 100_000, "\udcff"):
        path = tmp_path / "node"
        path.write_text(content, errors="surrogateescape")
        with refused(BusError, "not a freshness file"):
            FreshnessStore(path).begin(KEY)
        assert path.read_bytes() == content.encode(errors="surrogateescape"), content


def test_power_cycles_end_and_a_place_that_cannot_be_written_is_one_line(tmp_path):
    path = tmp_path / "node"
    path.write_text(json.dumps({"schema": FRESHNESS_SCHEMA, "trip": LARGEST_HALF, "heard": {}}))
    with pytest.raises(BusError, match="start with another key"):
        FreshnessStore(path).begin(KEY)
    with pytest.raises(StillwakeError, match="node"):
        FreshnessStore(path / "node").begin(KEY)
    with pytest.raises(ValueError, match="every 0"):
        FreshnessStore(path, every=0)
