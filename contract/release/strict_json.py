"""A reader of JSON that may come from anyone. It refuses content that two readers could interpret differently, or that
could overload a reader, and that Python's `json` accepts: NaN, numbers beyond a double, duplicate keys, lone
surrogates, integers of any length, and very deep nesting."""

import hashlib
import json
from collections.abc import Mapping
from math import isfinite
from typing import Any, Final

MAX_DEPTH: Final = 32
"""Largest accepted depth of nesting; the manifest of a release has six levels."""
_MAX_DIGITS: Final = 19
"""Number of digits of the largest 64-bit integer."""


def decode(raw: bytes) -> dict[str, Any]:
    """Return the table in a JSON file with these bytes. Raises ValueError if the bytes are anything else."""
    try:
        tree = json.loads(
            raw.decode("utf-8"),
            object_pairs_hook=_table,
            parse_constant=_no_number,
            parse_float=_finite,
            parse_int=_short,
        )
    except RecursionError as error:
        raise ValueError(f"it is nested more than {MAX_DEPTH} levels deep") from error
    if not isinstance(tree, dict):
        raise ValueError("it is not a table")
    _check(tree, 0)
    return tree


def encode(tree: Mapping[str, Any]) -> bytes:
    """Return a table as a JSON file's bytes. Raises ValueError for an infinite number, TypeError for unknown types."""
    return (json.dumps(tree, indent=2, sort_keys=True, allow_nan=False) + "\n").encode()


def digest_of(tree: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a table in hex; spacing and order of keys have no effect. Raises as `encode` does."""
    return hashlib.sha256(json.dumps(tree, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()).hexdigest()


def _table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for key, value in pairs:
        if key in table:
            raise ValueError(f"{key!r} occurs twice")
        table[key] = value
    return table


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is not a number")


def _finite(text: str) -> float:
    value = float(text)
    if not isfinite(value):
        raise ValueError(f"{text} is too large a number")
    return value


def _short(text: str) -> int:
    if len(text.lstrip("-")) > _MAX_DIGITS:
        raise ValueError(f"an integer has {len(text)} digits: must have at most {_MAX_DIGITS}")
    return int(text)


def _check(tree: Any, depth: int) -> None:
    if depth > MAX_DEPTH:
        raise ValueError(f"it is nested more than {MAX_DEPTH} levels deep")
    if isinstance(tree, str):
        try:
            tree.encode("utf-8")
        except UnicodeEncodeError as error:
            raise ValueError(f"{tree[:50]!a} is not text: half of a surrogate pair") from error
    elif isinstance(tree, dict):
        for key, value in tree.items():
            _check(key, depth)
            _check(value, depth + 1)
    elif isinstance(tree, list):
        for value in tree:
            _check(value, depth + 1)
