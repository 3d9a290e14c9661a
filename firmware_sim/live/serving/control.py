"""A viewer's request as it comes: any text, until it is looked at here."""

import json
from typing import Final

from firmware_sim.live.loop.messages import Answer, Message

LONGEST_REQUEST: Final = 16 * 1024
"""Bytes; a longer message ends its connection."""


def check(text: str | bytes) -> Answer | None:
    """None for a request that the loop can be asked; otherwise the answer with its error."""
    if isinstance(text, bytes):
        return {"error": "a request is text, and not bytes"}
    try:
        value = json.loads(text, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        return {"error": f"a request is JSON: {error}"}
    if not isinstance(value, dict):
        return {"error": 'a request is an object, such as {"id": 1, "set": {"enable": true}}'}
    return None if type(value.get("id", 0)) is int else {"error": "id: must be a whole number"}


def as_json(message: Message | Answer) -> str:
    """A message as it is sent; what JSON has no number for is null."""
    try:
        return json.dumps(message, allow_nan=False, separators=(",", ":"))
    except ValueError:
        return json.dumps(json.loads(json.dumps(message), parse_constant=lambda _: None), separators=(",", ":"))


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no number")
