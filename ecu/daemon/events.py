"""What happens to the ECU and is worth a line: for people, or as JSON for machines."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime


@dataclass(frozen=True, kw_only=True)
class Event:
    """One of them; `date_ns` counts from the epoch."""

    date_ns: int
    name: str
    text: str
    fields: Mapping[str, str | int | float] = field(default_factory=dict)


def plain(event: Event) -> str:
    """A line for people: `12:34:56.789 ecu: bus lost: ...`, UTC."""
    text = " ".join(event.text.split())
    return f"{_moment(event):%H:%M:%S}.{event.date_ns // 1_000_000 % 1000:03d} ecu: {text}"


def as_json(event: Event) -> str:
    """A line of JSON: `time` (RFC 3339, UTC), `event`, `text`, and the event's fields."""
    stamp = f"{_moment(event):%Y-%m-%dT%H:%M:%S}.{event.date_ns // 1000 % 1_000_000:06d}Z"
    return json.dumps({"time": stamp, "event": event.name, "text": event.text, **event.fields})


def _moment(event: Event) -> datetime:
    return datetime.fromtimestamp(event.date_ns // 1_000_000_000, UTC)
