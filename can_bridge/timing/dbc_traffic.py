"""Background traffic out of a description of a network: DBC, or what else cantools reads (ARXML, KCD, SYM)."""

from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Final

from can_bridge.timing.periodic_message import NS_PER_MS, OUR_IDS, PeriodicMessage
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS
from can_bridge.wire.message_specs import SPECS
from can_bridge.wire.network_file import load_network
from contract.config.vehicle import BusConfig
from contract.errors import BusError

if TYPE_CHECKING:
    from cantools.database.can.database import Database
    from cantools.database.can.message import Message

_OURS: Final = {(spec.name, spec.frame_id) for spec in SPECS}


@dataclass(frozen=True, kw_only=True)
class Traffic:
    """What other nodes send.

    Attributes:
        messages: to be sent, the highest priority first.
        left_out: the others that a file describes, each as "name (why)".
    """

    messages: tuple[PeriodicMessage, ...]
    left_out: tuple[str, ...] = ()


def read_traffic(path: Path, bus: BusConfig, taken: Collection[int], *, seed: int) -> Traffic:
    """The messages of a file at their cycle times (`GenMsgCycleTime` in a DBC), their phases drawn from the seed.

    Left out are messages without a cycle time, those that no CAN frame of ours can carry, and stillwake's own, which a
    vehicle's whole description holds too. Raises BusError if cantools is missing; the file is missing or damaged; no
    message can be sent; two have one identifier; or one does not go with this bus.

    Args:
        path: its ending gives its format.
        bus: whether CAN FD is spoken.
        taken: 11-bit identifiers that other messages may not have, besides ours.
    """
    database = load_network(path)
    random = Random(seed)
    messages: list[PeriodicMessage] = []
    left_out: list[str] = []
    for message in database.messages:
        why = _why_not(message, database)
        if why is not None:
            left_out.append(f"{message.name} ({why})")
            continue
        assert message.cycle_time is not None  # or there is a reason to leave it out
        _check(path, message, bus, taken)
        period_ns = round(message.cycle_time * NS_PER_MS)
        lengths = FD_LENGTHS if message.is_fd else CLASSIC_LENGTHS
        messages.append(
            PeriodicMessage(
                name=message.name,
                frame_id=message.frame_id,
                is_extended=message.is_extended_frame,
                is_fd=message.is_fd,
                length=next(length for length in lengths if length >= message.length),
                period_ns=period_ns,
                offset_ns=random.randrange(period_ns),
            )
        )
    if not messages:
        raise BusError(f"{path}: no message to send: {'; '.join(left_out[:3]) or 'it has none'}")
    messages.sort(key=lambda message: message.priority)
    for one, other in pairwise(messages):
        if one.priority == other.priority:
            raise BusError(f"{path}: {one.name} and {other.name} have one identifier, {one.frame_id:#x}")
    return Traffic(messages=tuple(messages), left_out=tuple(left_out))


def _why_not(message: "Message", database: "Database") -> str | None:
    """Why this message cannot be sent, or None."""
    if (message.name, message.frame_id) in _OURS:
        return "stillwake's own"
    if not message.cycle_time or round(message.cycle_time * NS_PER_MS) <= 0:
        return "no cycle time"
    if message.length > (FD_LENGTHS if message.is_fd else CLASSIC_LENGTHS)[-1]:
        return f"{message.length} bytes: more than a frame"
    if message.is_fd and not _switches_rate(message, database):
        return "CAN FD without bit-rate switching"
    return None


def _switches_rate(message: "Message", database: "Database") -> bool:
    """By the attribute `CANFD_BRS` or its default, if the file has it."""
    if message.dbc is None or database.dbc is None:
        return True
    given = message.dbc.attributes.get("CANFD_BRS")
    definition = database.dbc.attribute_definitions.get("CANFD_BRS")
    value = given.value if given is not None else None if definition is None else definition.default_value
    return value is None or str(value) in ("1", "")


def _check(path: Path, message: "Message", bus: BusConfig, taken: Collection[int]) -> None:
    if not message.is_extended_frame and (message.frame_id in OUR_IDS or message.frame_id in taken):
        raise BusError(
            f"{path}: {message.name} has identifier {message.frame_id:#x}, which another node sends: two must not "
            "send one identifier"
        )
    if message.is_fd and bus.frames == "classic":
        raise BusError(f"{path}: {message.name} is CAN FD, which a bus with bus.frames = classic cannot carry")
