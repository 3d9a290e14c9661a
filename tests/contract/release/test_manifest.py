"""Manifests whose own hash is right and whose content is not: one line for each, whatever is in it."""

import json
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from contract.errors import BundleManifestError
from contract.release.manifest import MANIFEST, Manifest, encode, open_manifest, parse
from contract.sensors import TRUCK
from contract.shipped import BUNDLE
from tests.contract.release.resealing import sealed

SHIPPED = json.loads((BUNDLE / MANIFEST).read_bytes())
PATH = Path("planted")


def read(raw: bytes) -> Manifest:
    return parse(PATH, open_manifest(PATH, raw))


def refusal(raw: bytes) -> str:
    with pytest.raises(BundleManifestError) as refused:
        read(raw)
    text = str(refused.value)
    assert text.isprintable()
    assert len(text) < 500
    return text


def changed(path: str, value: object) -> dict[str, Any]:
    """The shipped manifest with one value put in its place, by a dotted name; ... leaves it out."""
    body = deepcopy(SHIPPED)
    *sections, leaf = path.split(".")
    inner = body
    for name in sections:
        inner = inner[name]
    inner[leaf] = value
    if value is ...:
        del inner[leaf]
    return body


def leaves(tree: dict[str, Any], above: str = "") -> list[str]:
    """Every key of the manifest that has to be there, tables included; not those within files and provenance."""
    names = []
    for key, value in tree.items():
        names.append(above + key)
        if isinstance(value, dict) and key not in ("files", "provenance"):
            names += leaves(value, f"{above}{key}.")
    return names


def test_the_shipped_manifest_reads_and_has_the_trucks_positions():
    manifest = read((BUNDLE / MANIFEST).read_bytes())
    assert SHIPPED["schema"] in ("stillwake-bundle/8", "stillwake-bundle/9")
    assert manifest.sensor_positions == tuple(
        (float(x), float(y)) for x, y in TRUCK.positions[TRUCK.indices(manifest.sensors)]
    )
    assert read(sealed(SHIPPED)) == manifest
    # Zero must stay zero: an action and its mirror image differ in sign only.
    scaling = read(sealed(SHIPPED)).scaling
    assert scaling.window_mean == (*scaling.pressure_mean, 0.0)
    assert scaling.window_std == (*scaling.pressure_std, scaling.action_std)


def test_nothing_may_be_missing():
    """Nor what this version has a default for: the bundle was built with its maker's."""
    for name in leaves(SHIPPED):
        if name != "manifest_sha256":
            assert name.rsplit(".", 1)[-1] in refusal(sealed(changed(name, ...))), name


NUMBERS = [
    *("action_limit", "budget_ms", "compute_time_ms", "control_period", "window", "mpc.horizon", "mpc.iterations"),
    *("mpc.learning_rate", "mpc.weights.lift", "operating_point.speed", "scaling.action_std"),
]
NO_NUMBERS: list[Any] = [None, True, False, "1", [], {}, -1e300, float("nan"), float("inf"), 10**400]
NO_LISTS: list[Any] = [None, 1.0, "abcd", {}, [None] * 4, [True] * 4, [1e999] * 4, [float("nan")] * 4]
NO_TABLES = [[[0.1] * 4] * 3, [[0.1] * 3] * 4, [[0.1] * 4] * 3 + [[0.1] * 3 + [0.0]], [0.1] * 4, None, [["a"] * 4] * 4]
NO_POSITIONS = [[], [[0.0, 1.0]], [[0.0]] * 4, [[0.0] * 3] * 4, 3, "abcd", [["a", "b"]] * 4, [[True, 0.0]] * 4, {}]


def test_every_field_refuses_values_that_are_none_of_its_kind():
    for names, values in (
        (NUMBERS, NO_NUMBERS),
        (["mpc.drag_reference"], [value for value in NO_NUMBERS if value != -1e300]),
        (["security_version"], [-1, 2**32, 1.0, "1", True, None, [1]]),
        (["hardware"], ["", "x" * 101, "a\nb", "\x1b[2J", 1, ["ecu"]]),
        (["scaling.pressure_mean", "scaling.pressure_std"], NO_LISTS),
        (["scaling.force_mean", "scaling.force_std"], [v[:2] if isinstance(v, list) else v for v in NO_LISTS]),
        (["sensor_estimator.fast", "sensor_estimator.slow"], NO_TABLES),
        (["sensor_estimator"], [[], 3.0, "yes", True]),
        (["sensor_positions"], NO_POSITIONS),
    ):
        for name in names:
            for value in values:
                text = refusal(sealed(changed(name, value)))
                is_named = name.rsplit(".", 1)[-1] in text or "damaged" in text or "standard deviation" in text
                assert is_named, (name, value, text)


NONSENSE = [
    ("mpc", {}, "mpc.drag_reference is missing"),
    ("sensors", [], "sensor_positions has 4 positions: must have 0"),
    ("sensors", ["a", "b", "c", "c"], "'c': two sensors have this name"),
    ("sensors", ["a", "b", "c", "d\x1b[2J"], r"sensor 'd\x1b[2J': must be"),
    ("precision", "fp16", "precision = 'fp16': must be 'float32' or 'int8'"),
    ("compute_time_ms", 20.5, "compute_time_ms = 20.5: must be in 0..budget_ms, which is 20.0"),
    ("dataset_sha256", "0" * 63, "must be a SHA-256"),
    ("operating_point.width", -1.0, "operating_point.width = -1.0: must be in 0.01..100"),
    ("window", 10**9, "window = 1000000000: must be positive and at most 10000"),
    ("window", 10**400, "an integer has 401 digits"),
    ("created", "2026-02-30", "created = '2026-02-30': must be a date"),
    ("name", "a\x1b]0;title\x07", r"name 'a\x1b]0;title\x07': must be"),
    ("name", "\ud800", "half of a surrogate pair"),
    ("provenance", {"loss": float("nan")}, "NaN is not a number"),
    ("provenance", {"kind": "linear"}, "a linear controller, which only version 1.0.0 accepts"),
    ("files", {"\x1b[2J": "0" * 64}, r"'\x1b[2J' must be a plain file name"),
    ("files", {str(i): "0" * 64 for i in range(65)}, "files has 65 entries, more than 64"),
    ("speeds", {"slowest": 1.1, "fastest": 1.4}, "speeds = 1.1..1.4: must include 1"),
    ("resting.speeds", [1.4, 0.6], "resting.base: must have a value for each"),
    ("resting", {"speeds": [1.4, 0.6], "base": [-0.3] * 2, "swing": [0.1] * 2}, "must increase"),
    (
        "resting",
        {"speeds": [0.6], "base": [0.1], "swing": [0.1]},
        "resting.base: a wake has suction, but -base = -0.1: must",
    ),
    ("resting", {"speeds": [0.6], "base": [-0.3], "swing": [0.0]}, "resting.swing: 0.0: must be positive"),
    ("air_speed", [0.0] * 4, f"air_speed has 4 weights: must have {len(SHIPPED['air_speed'])}"),
    ("air_speed", [1e7] * len(SHIPPED["air_speed"]), "air_speed: 10000000.0 must be in -1e"),
    ("window", 6, "air_speed: needs pairs of sensors, and a window of more than 6 rows"),
    ("surprise\x1b[2J", 1, r"\x1b[2J"),
    ("schema", "stillwake-bundle/5", "reads 'stillwake-bundle/9': export the model again"),
    ("schema", "\x1b[2J" * 1000, "this version reads"),
]


def test_a_manifest_of_1_0_0_has_no_estimate_of_the_air_speed():
    old = {name: value for name, value in SHIPPED.items() if name != "air_speed"}
    assert read(sealed({**old, "schema": "stillwake-bundle/8"})).air_speed is None
    assert "air_speed" in refusal(sealed({**old, "schema": "stillwake-bundle/9"}))


def test_what_makes_no_sense_is_named():
    for name, value, named in NONSENSE:
        text = refusal(sealed(changed(name, value)))
        assert named in text, (name, value, text)
    assert "has 0 sensors: must have 1 to" in refusal(sealed({**SHIPPED, "sensors": [], "sensor_positions": None}))


def test_json_that_has_two_readings_or_no_end_is_refused():
    for raw, named in (
        (b'{"schema": 1, "schema": 2}', "'schema' occurs twice"),
        (b'{"schema": 1e999}', "1e999 is too large a number"),
        (b"\xff\xfe{\x00}\x00", "decode"),
        (b"[" * 100_000, "nested"),
        (b"", "is damaged"),
        (b"{" + b",".join(b'"%d":0' % i for i in range(100_000)) + b',"7":0}', "'7' occurs twice"),
    ):
        assert named in refusal(raw), raw[:30]
    # At some depths the parser passes and what works on its result does not: all are tried around the limit.
    for depth in (33, 500, 900, *range(960, 1010, 4), 5_000, 100_000):
        text = json.dumps({**SHIPPED, "provenance": "HERE"}).replace('"HERE"', '{"a":' * depth + "1" + "}" * depth)
        assert "nested more than 32 levels deep" in refusal(text.encode()), depth
    for odd in (float("nan"), object()):
        broken = replace(read(sealed(SHIPPED)), provenance={"loss": odd})
        with pytest.raises(BundleManifestError, match=r"manifest\.json: cannot be written"):
            encode(broken, {}, "0" * 64)
