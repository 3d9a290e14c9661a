import pytest
from cryptography.hazmat.primitives.ciphers import Cipher
from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.ciphers.modes import ECB

from can_bridge.flashing.access_level import Level
from can_bridge.secoc.key import write_key
from can_bridge.uds.access_key import AccessKey
from contract.errors import KeyFileError
from tests.can_bridge.uds.scripted_ecu import SECRET

SEED = bytes(range(16))


def cmac(key: bytes, message: bytes) -> bytes:
    """AES-CMAC of one block or more whole ones, from AES-ECB alone (RFC 4493, sections 2.3 and 2.4)."""

    def aes(block: bytes) -> bytes:
        step = Cipher(AES(key), ECB()).encryptor()
        return step.update(block) + step.finalize()

    def doubled(block: bytes) -> bytes:
        value = int.from_bytes(block, "big") << 1
        return (value & (2**128 - 1) ^ (0x87 if value >> 128 else 0)).to_bytes(16, "big")

    def xor(a: bytes, b: bytes) -> bytes:
        return bytes(x ^ y for x, y in zip(a, b, strict=True))

    blocks = [message[i : i + 16] for i in range(0, len(message), 16)]
    if len(blocks[-1]) == 16:
        blocks[-1] = xor(blocks[-1], doubled(aes(bytes(16))))
    else:
        blocks[-1] = xor((blocks[-1] + b"\x80").ljust(16, b"\0"), doubled(doubled(aes(bytes(16)))))
    state = bytes(16)
    for block in blocks:
        state = aes(xor(state, block))
    return state


def test_reference_gives_the_published_answers():
    """RFC 4493, section 4, examples 2 and 3."""
    message = bytes.fromhex("6bc1bee22e409f96e93d7e117393172aae2d8a571e03ac9c9eb76fac45af8e5130c81c46a35ce411")
    assert cmac(SECRET, message[:16]).hex() == "070a16b46b4d4144f79bdd9dd04a287c"
    assert cmac(SECRET, message).hex() == "dfa66747de9ae63030ca32611497c827"


def test_answer_is_cmac_under_the_level_s_own_key():
    for level in Level:
        level_key = cmac(SECRET, b"stillwake access" + bytes([level]))
        assert AccessKey(SECRET).answer(level, SEED) == cmac(level_key, SEED)


def test_a_key_file_is_read_and_shows_nowhere(tmp_path):
    write_key(tmp_path / "access.key", SECRET)
    key = AccessKey.read(tmp_path / "access.key")
    assert key.answer(Level.PROGRAMMING, SEED) == AccessKey(SECRET).answer(Level.PROGRAMMING, SEED)
    assert SECRET.hex()[:8] not in repr(key) + repr(vars(key))
    with pytest.raises(KeyFileError, match=r"other\.key: cannot read the key"):
        AccessKey.read(tmp_path / "other.key")
    with pytest.raises(ValueError, match="a key of zeros"):
        AccessKey(bytes(16))
