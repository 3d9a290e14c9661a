"""Fields of a protobuf message (the wire format of https://protobuf.dev/programming-guides/encoding), read strictly.

An own reader, because nothing on a vehicle reads a graph: `onnx` comes with the training extra only, and ONNX Runtime
shows nothing of a graph but its inputs and outputs. The `protobuf` package, which it brings along, would need ONNX's
schema and reads leniently: it keeps what it does not know and merges what is there twice. This reader takes what a
schema names and refuses everything else, so that no second reader finds something other in the same bytes.
"""

from collections.abc import Iterator, Mapping
from enum import Enum
from struct import unpack_from
from typing import Any, Final, NamedTuple

_VARINT: Final = 0
_BYTES: Final = 2
_FIXED32: Final = 5
_MAX_SHIFT: Final = 63


class Kind(Enum):
    """How a field is stored."""

    INT = "int"
    FLOAT = "float"
    BYTES = "bytes"
    TEXT = "text"


class Field(NamedTuple):
    """A field that a message may have.

    Attributes:
        name: for the result and for messages.
        most: how many values it may have; None for a singular field. Numbers of several may be packed.
    """

    name: str
    kind: Kind
    most: int | None = None


Message = dict[str, Any]
"""Field names to values; every field of the schema is there, an absent one as None or as an empty list."""


def read(data: memoryview, schema: Mapping[int, Field]) -> Message:
    """The fields of a message.

    Args:
        schema: the fields it may have, by number.

    Raises:
        ValueError: the bytes are no message, or a field is unknown, doubled or stored in another way.
    """
    message: Message = {item.name: None if item.most is None else [] for item in schema.values()}
    for number, wire, value in _fields(data):
        item = schema.get(number)
        if item is None:
            raise ValueError(f"field {number} is not expected")
        values = _values(item, wire, value)
        if item.most is None:
            if message[item.name] is not None:
                raise ValueError(f"{item.name} is there twice")
            (message[item.name],) = values
            continue
        message[item.name] += values
        if len(message[item.name]) > item.most:
            raise ValueError(f"{item.name} is there more than {item.most} times")
    return message


def _fields(data: memoryview) -> Iterator[tuple[int, int, int | memoryview]]:
    """Number, wire type and value of every field."""
    place, end = 0, len(data)
    while place < end:
        key, place = _varint(data, place)
        number, wire = key >> 3, key & 7
        if number == 0:
            raise ValueError("a field has number 0")
        if wire == _VARINT:
            value, place = _varint(data, place)
            yield number, wire, value
            continue
        if wire == _BYTES:
            size, place = _varint(data, place)
        elif wire == _FIXED32:
            size = 4
        else:
            raise ValueError(f"field {number} has wire type {wire}")
        if size > end - place:
            raise ValueError(f"field {number} ends behind its message")
        yield number, wire, data[place : place + size]
        place += size


def _varint(data: memoryview, place: int) -> tuple[int, int]:
    """An unsigned number of up to 64 bits, and the place behind it."""
    value = shift = 0
    while True:
        if place >= len(data):
            raise ValueError("the message ends within a number")
        byte = data[place]
        value |= (byte & 0x7F) << shift
        place += 1
        if byte < 0x80:
            if value >= 2**64:
                raise ValueError("a number has more than 64 bits")
            return value, place
        shift += 7
        if shift > _MAX_SHIFT:
            raise ValueError("a number has more than 64 bits")


def _values(item: Field, wire: int, value: int | memoryview) -> list[Any]:
    if isinstance(value, int):
        if item.kind is Kind.INT:
            return [_signed(value)]
    elif item.kind is Kind.FLOAT and wire == _FIXED32:
        return [unpack_from("<f", value)[0]]
    elif wire == _BYTES and item.kind is Kind.BYTES:
        return [value]
    elif wire == _BYTES and item.kind is Kind.TEXT:
        return [str(value, "utf-8")]
    elif wire == _BYTES and item.kind is Kind.INT and item.most is not None:
        return _packed(value, item)
    raise ValueError(f"{item.name} is not stored as {item.kind.value}")


def _signed(value: int) -> int:
    """Two's complement of 64 bits, as int64 and enums are stored."""
    return value - 2**64 if value >= 2**63 else value


def _packed(value: memoryview, item: Field) -> list[int]:
    found: list[int] = []
    place = 0
    while place < len(value):
        number, place = _varint(value, place)
        found.append(_signed(number))
        if item.most is not None and len(found) > item.most:
            raise ValueError(f"{item.name} is there more than {item.most} times")
    return found
