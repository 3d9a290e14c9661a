import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import given
from hypothesis import strategies as st

from contract.errors import KeyFileError
from contract.release import key_list, signing
from contract.release.key_list import KeyList
from contract.release.signing import PublicKey
from tests.examples import examples

ROOT = Ed25519PrivateKey.from_private_bytes(bytes([1]) * 32)
STRANGER = Ed25519PrivateKey.from_private_bytes(bytes([2]) * 32)
TRUSTED = signing.public_key(ROOT)
KEYS = [PublicKey(bytes([number]) * 32) for number in range(1, 41)]
LISTED = KeyList(version=3, keys=frozenset(KEYS[:2]), revoked=frozenset(KEYS[2:3]))
RAW = key_list.encode(LISTED, ROOT)


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


def laid_out(
    version: int = 3, keys: bytes = b"\1" * 32 + b"\2" * 32, revoked: bytes = b"\3" * 32, *, key=ROOT, **changes: int
) -> bytes:
    """A list by hand; `changes` are its bytes by "at_" and their places."""
    head = b"SWKEYS01" + version.to_bytes(4, "big") + bytes([len(keys) // 32, len(revoked) // 32, 0, 0])
    text = bytearray(head + TRUSTED.raw + keys + revoked)
    for place, value in changes.items():
        text[int(place.removeprefix("at_"))] = value
    return bytes(text) + key.sign(bytes(text))


def test_a_list_is_as_it_is_described_and_the_root_key_signs_it():
    assert laid_out() == RAW
    # Only the root key signs.
    message = refusal(key_list.encode(LISTED, STRANGER))
    assert signing.public_key(STRANGER).fingerprint in message
    assert f"must be by the root key {TRUSTED.fingerprint}" in message
    assert "the signature does not match the root key" in refusal(laid_out(key=STRANGER))
    # No change of a list goes unseen.
    for bit in range(0, 8 * len(RAW), 3):
        damaged = bytearray(RAW)
        damaged[bit // 8] ^= 1 << bit % 8
        refusal(bytes(damaged))
    for length in range(len(RAW)):
        refusal(RAW[:length])
    refusal(RAW + b"\n")


def test_what_is_no_list_is_refused_even_if_the_root_key_signed_it():
    one, two, many = b"\1" * 32, b"\2" * 32, b"".join(key.raw for key in KEYS)
    for raw, message in (
        (b'{"keys":[]}', "has an old format; make it again with `stillwake bundle keylist`"),
        (laid_out(0), "version 0: must be in 1..4294967295"),
        (laid_out(keys=b""), "0 keys"),
        (laid_out(keys=many[: 17 * 32], revoked=b""), "17 keys"),
        (laid_out(keys=one, revoked=many[64 : 19 * 32]), "17 revoked"),
        (laid_out(revoked=one), "is allowed and revoked"),
        (laid_out(keys=bytes.fromhex("ec" + "ff" * 31)), f"key ec{'ff' * 31} is of small order"),
        (laid_out(keys=one + one), "must ascend"),
        (laid_out(revoked=two + one), "must ascend"),
        (laid_out(at_12=1), "1 + 1 keys in 96 bytes"),
        (laid_out(at_15=1), "reserved bytes: 1"),
    ):
        assert message in refusal(raw)
