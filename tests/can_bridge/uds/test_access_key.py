import pytest
from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.cmac import CMAC

from can_bridge.flashing.access_level import Level
from can_bridge.secoc.key import write_key
from can_bridge.uds.security import AccessKey
from tests.can_bridge.uds.scripted_ecu import SECRET

SEED = bytes(range(16))


def cmac(key: bytes, message: bytes) -> bytes:
    """By the library; `tests/can_bridge/secoc/test_key.py` has the published answers of our own."""
    made = CMAC(AES(key))
    made.update(message)
    return made.finalize()


def test_answer_is_cmac_under_the_level_s_own_key():
    for level in Level:
        level_key = cmac(SECRET, b"stillwake access" + bytes([level]))
        assert AccessKey(SECRET).answer(level, SEED) == cmac(level_key, SEED)


def test_a_key_file_is_read_and_shows_nowhere(tmp_path):
    write_key(tmp_path / "access.key", SECRET)
    key = AccessKey.read(tmp_path / "access.key")
    assert key.answer(Level.PROGRAMMING, SEED) == AccessKey(SECRET).answer(Level.PROGRAMMING, SEED)
    assert SECRET.hex()[:8] not in repr(key) + repr(vars(key))
    with pytest.raises(ValueError, match="a key of zeros"):
        AccessKey(bytes(16))
