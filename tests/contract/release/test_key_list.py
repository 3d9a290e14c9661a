import json

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import given
from hypothesis import strategies as st

from contract.errors import KeyFileError
from contract.release import key_list, signing, strict_json
from contract.release.key_list import KeyList
from contract.release.signing import PublicKey
from tests.examples import examples

ROOT = Ed25519PrivateKey.from_private_bytes(bytes([1]) * 32)
STRANGER = Ed25519PrivateKey.from_private_bytes(bytes([2]) * 32)
TRUSTED = signing.public_key(ROOT)
KEYS = [PublicKey(bytes([number]) * 32) for number in range(1, 41)]
LISTED = KeyList(version=3, keys=frozenset(KEYS[:2]), revoked=frozenset(KEYS[2:3]))
RAW = key_list.encode(LISTED, ROOT)
BODY = {"schema": "stillwake-keys/1", "version": 3, "keys": ["01" * 32, "02" * 32], "revoked": ["03" * 32]}


def signed(text: bytes, key: Ed25519PrivateKey = ROOT) -> bytes:
    return text + signing.sign(key, text)


def refusal(raw: bytes) -> str:
    with pytest.raises(KeyFileError) as refused:
        key_list.decode(raw, TRUSTED)
    assert str(refused.value).isprintable()
    return str(refused.value)


@examples(50)
@given(
    st.integers(1, 2**32 - 1),
    st.sets(st.sampled_from(KEYS[:20]), min_size=1, max_size=16),
    st.sets(st.sampled_from(KEYS[20:]), max_size=16),
)
def test_what_goes_in_comes_out(version, keys, revoked):
    listed = KeyList(version=version, keys=frozenset(keys), revoked=frozenset(revoked))
    assert key_list.decode(key_list.encode(listed, ROOT), TRUSTED) == listed


def test_a_list_is_json_with_the_root_keys_signature():
    """Verified with `cryptography` itself, and read with `json`."""
    text, signature = RAW[:-230], RAW[-230:].decode()
    assert json.loads(text) == BODY
    ROOT.public_key().verify(bytes.fromhex(signature.split("signature ")[1]), text)
    # Only the root key signs.
    message = refusal(key_list.encode(LISTED, STRANGER))
    assert signing.public_key(STRANGER).fingerprint in message
    assert f"must be by the root key {TRUSTED.fingerprint}" in message
    # No change of a list goes unseen.
    for bit in range(8 * len(RAW)):
        damaged = bytearray(RAW)
        damaged[bit // 8] ^= 1 << bit % 8
        refusal(bytes(damaged))
    for length in range(len(RAW)):
        refusal(RAW[:length])
    refusal(RAW + b"\n")


def test_what_is_no_list_is_refused_even_if_the_root_key_signed_it():
    for body, message in (
        (BODY | {"schema": "stillwake-keys/2"}, "schema 'stillwake-keys/2'"),
        (BODY | {"version": 0}, "version 0: must be in 1"),
        (BODY | {"version": 2**32}, "must be in 1..4294967295"),
        (BODY | {"version": True}, "must be a whole number"),
        (BODY | {"keys": []}, "0 keys"),
        (BODY | {"keys": [key.raw.hex() for key in KEYS[:17]]}, "17 keys"),
        (BODY | {"revoked": [key.raw.hex() for key in KEYS[20:37]]}, "17 revoked"),
        (BODY | {"keys": ["00" * 31]}, "64 hex digits"),
        (BODY | {"keys": ["zz" * 32]}, "damaged"),
        (BODY | {"keys": [1]}, "damaged"),
        (BODY | {"revoked": ["01" * 32]}, "is allowed and revoked"),
        (BODY | {"keys": ["ec" + "ff" * 31]}, f"key ec{'ff' * 31} is of small order"),
        (BODY | {"more": 1}, "must have keys, revoked, schema and version"),
        (BODY | {"keys": ["00" * 32, "00" * 32]}, "twice"),
        (BODY | {"keys": ["0A" * 32]}, "64 hex digits"),
        (BODY | {"keys": [" ".join(["00"] * 32)]}, "64 hex digits"),
        ({name: value for name, value in BODY.items() if name != "revoked"}, "must have keys, revoked"),
        ({}, "must have keys, revoked"),
    ):
        assert message in refusal(signed(strict_json.encode(body)))


@examples(200)
@given(st.binary(max_size=300))
def test_any_signed_bytes_are_refused_or_are_a_list(text):
    try:
        listed = key_list.decode(signed(text), TRUSTED)
    except KeyFileError:
        return
    assert key_list.decode(key_list.encode(listed, ROOT), TRUSTED) == listed
