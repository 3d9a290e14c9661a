import copy
import os
import pickle

import pytest

from can_bridge.secoc.key import Key, read_key, write_key
from contract.errors import KeyFileError
from tests.refused import refused

SECRET = bytes.fromhex("2b7e151628aed2a6abf7158809cf4f3c")
"""The key of RFC 4493's examples."""
MESSAGE = bytes.fromhex(
    "6bc1bee22e409f96e93d7e117393172aae2d8a571e03ac9c9eb76fac45af8e5130c81c46a35ce411e5fbc1191a0a52eff69f2445df4f9b17"
    "ad2b417be66c3710"
)


def test_published_answers():
    """RFC 4493, section 4, examples 1 to 4; twice, since the prepared key must not change with use."""
    for length, expected in [
        (0, "bb1d6929e95937287fa37d129b756746"),
        (16, "070a16b46b4d4144f79bdd9dd04a287c"),
        (40, "dfa66747de9ae63030ca32611497c827"),
        (64, "51f0bebf7e3b9d92fc49741779363cfe"),
    ]:
        key = Key(SECRET)
        for _ in range(2):
            assert key.cmac(MESSAGE[:length]).hex() == expected, (length, expected)


def written(path, content: bytes, mode: int = 0o600):
    path.write_bytes(content)
    path.chmod(mode)
    return path


def test_every_form_of_a_key_file_is_read_and_what_is_no_key_is_refused_without_showing_it(tmp_path):
    digits = SECRET.hex().encode()
    for content in (SECRET, digits, digits + b"\n", digits + b"\r\n", digits.upper()):
        assert read_key(written(tmp_path / "key", content)).cmac(b"") == Key(SECRET).cmac(b""), content
    wrong = [b"", SECRET[:-1], SECRET + b"\n", SECRET * 4, b"\xff" * 32, b"2b 7e 15 16 28 ae d2 a6 abf7158809"]
    wrong += [digits[:-1], digits + b"\n\n", digits + b"0", b" " + digits, digits[:-2] + b"0x"]
    zeros = (bytes(16), b"0" * 32)
    for content, culprit in (*((each, "not a key") for each in wrong), *((each, "a key of zeros") for each in zeros)):
        with refused(KeyFileError, culprit) as caught:
            read_key(written(tmp_path / "key", content))
        text = repr(caught.value) + str(caught.value)
        assert str(tmp_path / "key") in text, (content, culprit)
        assert SECRET.hex()[:8] not in text, (content, culprit)
        assert caught.value.__cause__ is None, (content, culprit)


def test_a_key_file_is_its_owners(tmp_path):
    for mode in (0o640, 0o604, 0o660, 0o610):
        with refused(KeyFileError, "chmod 600"):
            read_key(written(tmp_path / "key", SECRET, mode))
    os.mkfifo(tmp_path / "pipe")
    places = {tmp_path / "none": "No such file", tmp_path: "directory", tmp_path / "pipe": "must be a regular file"}
    for path, culprit in places.items():
        with refused(KeyFileError, culprit):
            read_key(path)
    # `tests/stillwake/commands/can/test_send.py` writes one, which is its owner's and is written once.
    with refused(KeyFileError, "cannot write"):
        write_key(tmp_path / "no" / "folder", SECRET)


def test_a_key_shows_itself_nowhere():
    key = Key(SECRET)
    for text in (repr(key), str(key), repr(vars(key))):
        assert SECRET.hex() not in text and repr(SECRET)[2:-1] not in text
    for leak in (pickle.dumps, copy.deepcopy):
        with pytest.raises(TypeError):
            leak(key)
    for secret in (b"", bytes(15), bytes(17), bytes(16)):
        with refused(ValueError, "a key of"):
            Key(secret)
