"""The profiles in use, by their number in AUTOSAR and in the DBC."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Protocol

from can_bridge.e2e import profile2, profile5
from can_bridge.wire.message_specs import MessageSpec


class Protect(Protocol):
    """Fills a message's header in."""

    def __call__(self, data: bytes, *, data_id: int, counter: int) -> bytes: ...


class Check(Protocol):
    """Whether a message's CRC fits."""

    def __call__(self, data: bytes, *, data_id: int) -> bool: ...


@dataclass(frozen=True, kw_only=True)
class Profile:
    """What sender and receiver need of one profile.

    Attributes:
        counter_of, crc_of: what a protected message's header holds.
        header_bits: at the start of the message, the least significant bit of a byte first.
        counter_period: after so many frames the counter begins again.
    """

    protect: Protect
    check: Check
    counter_of: Callable[[bytes], int]
    crc_of: Callable[[bytes], int]
    header_bits: int
    counter_period: int


PROFILES: Final[Mapping[int, Profile]] = {
    number: Profile(
        protect=module.protect,
        check=module.check,
        counter_of=module.counter_of,
        crc_of=module.crc_of,
        header_bits=module.HEADER_BITS,
        counter_period=module.COUNTER_PERIOD,
    )
    for number, module in ((2, profile2), (5, profile5))
}


def profile_of(spec: MessageSpec) -> Profile:
    """The profile that protects a message."""
    return PROFILES[spec.profile]
