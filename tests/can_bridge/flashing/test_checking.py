"""Every verdict, by an image with this one fault; `tests/contract/release` damages bundles and images in every way."""

import json
from dataclasses import replace
from typing import Any

from can_bridge.flashing.checking import Rules, check, fits_as, judge_image
from can_bridge.flashing.verdicts import Verdict
from contract.config.operating_point import OperatingPoint
from contract.release import key_list, signing, strict_json
from contract.release.checks import CONTROLLER, SIGNATURE, dbc_sha256
from contract.release.container import files_of, image_of
from contract.release.controller_image import ImageFacts, seal
from contract.release.key_list import KeyList
from contract.release.manifest import MANIFEST
from contract.release.signing import public_key
from contract.release.strict_json import digest_of
from tests.can_bridge.flashing.releases import HARDWARE, RELEASE, ROOT, SECOND, STRANGER, fits, image, keys

RULES = Rules(
    keys=key_list.decode(keys(2, RELEASE, revoked=(SECOND,)), public_key(ROOT)),
    hardware=HARDWARE,
    fits=fits,
    least_security_version=3,
)
GOOD = image(version=3)


def with_file(name: str, content: bytes | None) -> bytes:
    files = {**files_of(GOOD), name: content}
    return image_of({name: content for name, content in files.items() if content is not None})


def with_manifest(**changes: object) -> bytes:
    """The image with another manifest, its own hash and its signature put right."""
    body = json.loads(files_of(GOOD)[MANIFEST]) | changes
    del body["manifest_sha256"]
    raw = strict_json.encode(body | {"manifest_sha256": digest_of(body)})
    return image_of(files_of(GOOD) | {MANIFEST: raw, SIGNATURE: signing.sign(RELEASE, raw)})


def test_a_release_in_order_is_good_and_comes_with_its_bundle():
    verdict, bundle = check(GOOD, RULES)
    assert verdict == Verdict.GOOD
    assert bundle is not None and bundle.is_trusted and bundle.signer == public_key(RELEASE)
    assert bundle.files == {CONTROLLER: files_of(GOOD)[CONTROLLER]}
    assert check(image(version=2**32 - 1, hardware=HARDWARE), RULES)[0] == Verdict.GOOD


def test_what_is_wrong_is_the_verdict():
    for number, (wrong, expected) in enumerate([
        (b"", Verdict.DAMAGED),
        (with_file(MANIFEST, None), Verdict.DAMAGED),
        (with_file(CONTROLLER, b"other"), Verdict.DAMAGED),
        (with_file(SIGNATURE, None), Verdict.UNSIGNED),
        (with_file(SIGNATURE, signing.sign(RELEASE, b"other")), Verdict.BAD_SIGNATURE),
        (image(version=3, key=STRANGER), Verdict.UNKNOWN_KEY),
        (image(version=3, key=SECOND), Verdict.REVOKED_KEY),
        (with_manifest(dbc_sha256="0" * 64), Verdict.WRONG_DBC),
        (image(version=3, hardware="other"), Verdict.WRONG_HARDWARE),
        (image(version=3, control_period=0.1), Verdict.WRONG_PERIOD),
        (image(version=3, operating_point=OperatingPoint(speed=30.0)), Verdict.WRONG_VEHICLE),
        (image(version=2), Verdict.TOO_OLD),
        (image(version=0), Verdict.TOO_OLD),
        # The first check that fails counts.
        (image(version=2, key=STRANGER, hardware="other"), Verdict.UNKNOWN_KEY),
        (image(version=2, hardware="other", control_period=0.1), Verdict.WRONG_HARDWARE),
        (image(version=2, control_period=0.1), Verdict.WRONG_PERIOD),
    ]):  # fmt: skip
        assert check(wrong, RULES) == (expected, None), number


def for_controllers(version: int = 3, key: Any = RELEASE, **changes: Any) -> bytes:
    own = {"layout": bytes(32), "dbc": bytes.fromhex(dbc_sha256()), "digest": bytes(32), "period_ns": 20_000_000,
           "operating_point": (2.6, 25.0, 1.2), "action_limit": 0.075, "sensors": 4, "hardware": None}  # fmt: skip
    return seal(b"payload", ImageFacts(**{"name": "one", "security_version": version, **own, **changes}), key)


def test_an_image_for_microcontrollers_is_judged_by_its_header():
    rules = replace(RULES, fits=fits_as(for_controllers()))
    for wrong, expected in (
        (for_controllers(hardware=HARDWARE), Verdict.GOOD),
        (for_controllers()[:-1] + b"!", Verdict.DAMAGED),
        (for_controllers(key=None), Verdict.UNSIGNED),
        (for_controllers()[:500] + bytes(12) + b"payload", Verdict.BAD_SIGNATURE),
        (for_controllers(key=STRANGER), Verdict.UNKNOWN_KEY),
        (for_controllers(key=SECOND), Verdict.REVOKED_KEY),
        (for_controllers(dbc=bytes(32), layout=b"x" * 32), Verdict.WRONG_DBC),
        (for_controllers(layout=b"x" * 32, hardware="other"), Verdict.WRONG_BUILD),
        (for_controllers(hardware="other"), Verdict.WRONG_HARDWARE),
        (for_controllers(period_ns=1), Verdict.WRONG_PERIOD),
        (for_controllers(sensors=5), Verdict.WRONG_VEHICLE),
        (for_controllers(version=2), Verdict.TOO_OLD),
    ):
        verdict, found = judge_image(wrong, rules, layout=bytes(32))
        assert (verdict, found is None) == (expected, expected is not Verdict.GOOD)
        # What the build cannot open is judged last, and where nothing else is wrong.
        closed = judge_image(wrong, rules, layout=bytes(32), opens=lambda payload: payload != b"payload")
        assert closed == ((Verdict.WRONG_BUILD, None) if expected is Verdict.GOOD else (expected, None))
    assert judge_image(for_controllers(), replace(rules, keys=None), layout=bytes(32))[0] is Verdict.UNKNOWN_KEY


def test_a_key_of_the_list_must_have_signed():
    none = replace(RULES, keys=None)
    assert check(GOOD, none)[0] == Verdict.UNKNOWN_KEY
    assert check(with_file(SIGNATURE, None), none)[0] == Verdict.UNSIGNED
    both = KeyList(version=1, keys=frozenset({public_key(RELEASE), public_key(SECOND)}))
    for key in (RELEASE, SECOND):
        assert check(image(version=3, key=key), replace(RULES, keys=both))[0] == Verdict.GOOD
