"""Keys that sign anything are nobody's: the list of them against the curve's own arithmetic (RFC 8032, section 5.1)."""

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

from contract.errors import KeyFileError
from contract.release import signing

P = 2**255 - 19
D = -121665 * pow(121666, P - 2, P) % P


def x_of(y: int) -> int | None:
    """A root x of -x^2 + y^2 = 1 + d x^2 y^2; None if there is none."""
    square = (y * y - 1) * pow(D * y * y + 1, P - 2, P) % P
    x = pow(square, (P + 3) // 8, P)
    if (x * x - square) % P:
        x = x * pow(2, (P - 1) // 4, P) % P
    return x if (x * x - square) % P == 0 else None


def doubled(x: int, y: int) -> tuple[int, int]:
    product = D * x * x * y * y % P
    return 2 * x * y * pow(1 + product, P - 2, P) % P, (y * y + x * x) * pow(1 - product, P - 2, P) % P


def test_every_key_on_the_list_is_nothing_eight_times_and_none_is_missing():
    for raw in signing._SMALL_ORDER:
        y = int.from_bytes(raw, "little") % P
        x = x_of(y)
        assert x is not None
        for _ in range(3):
            x, y = doubled(x, y)
        assert (x, y) == (0, 1)
    # Eight points have five different y; of them 0 and 1 fit into 255 bits a second time, not reduced.
    found = {int.from_bytes(raw, "little") for raw in signing._SMALL_ORDER}
    assert len({y % P for y in found}) == 5
    assert found >= {y + P for y in found if y + P < 2**255}


def test_such_a_key_is_not_trusted_and_its_signature_is_bad(tmp_path):
    for sign_bit in (0, 0x80):
        for raw in sorted(signing._SMALL_ORDER):
            key = bytes([*raw[:31], raw[31] | sign_bit])
            # R the neutral point and s = 0 is what passes for any text where the library does not look.
            value = b"\x01" + bytes(63)
            text = f"stillwake-signature/1\nkey {key.hex()}\nsignature {value.hex()}\n".encode()
            assert signing.signer(text, b"any text") is None
    weak = Ed25519PublicKey.from_public_bytes(b"\x01" + bytes(31))
    path = tmp_path / "weak.pub"
    path.write_bytes(weak.public_bytes(serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo))
    with pytest.raises(KeyFileError, match=r"weak\.pub: is of small order"):
        signing.read_public_key(path)
