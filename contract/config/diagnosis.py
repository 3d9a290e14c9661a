"""The settings of the CAN identifiers for diagnosis and calibration. No control message may have these identifiers."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Annotated, Final, NamedTuple

from contract.config.notes import ours, standard
from contract.config.rules import Rule, Settings, require

MOST_STANDARD: Final = 0x7FF
MOST_EXTENDED: Final = 0x1FFF_FFFF
_TEXT: Final = re.compile(r"0[xX]([0-9a-fA-F]{1,3}|[0-9a-fA-F]{8})")
_SHORT: Final = 3
"""Most hex digits of an 11-bit identifier. A 29-bit identifier has eight; four to seven count as a typing error."""
_NOTATION: Final = "0x and 3 hex digits (11 bits, up to 0x7FF), or 0x and 8 (29 bits, up to 0x1FFFFFFF)"
_PAGE: Final = "reference/diagnosis.md#identifiers-on-the-bus"


class CanId(NamedTuple):
    """A CAN identifier. An 11-bit and a 29-bit identifier with the same number are different identifiers."""

    number: int
    is_extended: bool = False

    def __str__(self) -> str:
        return f"0x{self.number:08X}" if self.is_extended else f"0x{self.number:03X}"


def parse_id(value: int | str) -> CanId | None:
    """Parse the identifier in a setting. Up to three hex digits give 11 bits, and eight hex digits give 29 bits. An int
    below 0x1000 counts as three digits, a larger int as eight digits. Return None if the value is no identifier."""
    if isinstance(value, int):
        value = f"0x{value:03X}" if value < 1 << 4 * _SHORT else f"0x{value:08X}"
    found = _TEXT.fullmatch(value)
    if found is None:
        return None
    number, is_extended = int(found[1], 16), len(found[1]) > _SHORT
    return CanId(number, is_extended) if number <= (MOST_EXTENDED if is_extended else MOST_STANDARD) else None


_ID: Final = Rule(wording=_NOTATION, holds=lambda value: parse_id(value) is not None)
_ID_OR_NONE: Final = Rule(wording=f"empty, {_NOTATION}", holds=lambda value: value == "" or _ID.holds(value))


@dataclass(frozen=True, kw_only=True)
class DiagnosisConfig(
    Settings, section="bus.diagnosis", source=standard("ISO 15765-4", "the first ECU of emissions diagnosis")
):
    """The CAN identifiers with which a tester and a calibration tool reach the ECU. An identifier of up to three hex
    digits (`0x7E0`) has 11 bits; an identifier of eight digits (`0x18DA10F1`) has 29 bits. The ECU and the tool need
    equal settings."""

    request_id: Annotated[int | str, _ID] = "0x7E0"
    """Identifier of the tester's requests to this ECU alone (physical addressing)."""
    response_id: Annotated[int | str, _ID] = "0x7E8"
    """Identifier of the ECU's answers to the tester."""
    functional_id: Annotated[int | str, _ID_OR_NONE, ours("requests to every ECU get no answer", page=_PAGE)] = ""
    """Identifier of the tester's requests to every ECU (functional addressing), usually 0x7DF or 0x18DB33F1. Without
    this identifier, the ECU ignores such requests."""
    xcp_command_id: Annotated[int | str, _ID, ours("not used by another message", page=_PAGE)] = "0x7D0"
    """Identifier of the calibration tool's commands."""
    xcp_response_id: Annotated[int | str, _ID, ours("not used by another message", page=_PAGE)] = "0x7D8"
    """Identifier of the ECU's packets to the calibration tool."""
    xcp: Annotated[bool, ours("a calibration tool works without a change of settings", page=_PAGE)] = True
    """Whether the ECU answers a calibration tool (XCP). If false, the ECU in C contains no code for XCP."""

    def _check_together(self) -> None:
        taken = dict(_messages())
        for name in ("request_id", "response_id", "functional_id", "xcp_command_id", "xcp_response_id"):
            found, like = parse_id(getattr(self, name)), "xcp_command_id" if name.startswith("xcp") else "request_id"
            if found is None:
                continue
            object.__setattr__(self, name, str(found))
            require(found not in taken, self, name, f"an identifier other than that of {taken.get(found)}")
            same = found.is_extended == self._id(like).is_extended
            require(same, self, name, f"{'11' if found.is_extended else '29'} bits long, like bus.diagnosis.{like}")
            taken[found] = f"bus.diagnosis.{name}"

    @property
    def request(self) -> CanId:
        return self._id("request_id")

    @property
    def response(self) -> CanId:
        return self._id("response_id")

    @property
    def functional(self) -> CanId | None:
        return parse_id(self.functional_id)

    @property
    def xcp_command(self) -> CanId:
        return self._id("xcp_command_id")

    @property
    def xcp_response(self) -> CanId:
        return self._id("xcp_response_id")

    @property
    def heard(self) -> frozenset[CanId]:
        """Identifiers of the diagnosis and calibration frames that an ECU receives."""
        return frozenset(filter(None, (self.request, self.functional, self.xcp_command if self.xcp else None)))

    @property
    def names(self) -> Mapping[CanId, str]:
        """The purpose of each identifier, as a short text."""
        found = {self.request: "UDS request", self.response: "UDS answer"}
        found |= {self.xcp_command: "XCP command", self.xcp_response: "XCP answer"}
        return found if self.functional is None else found | {self.functional: "UDS request to all"}

    def _id(self, name: str) -> CanId:
        found = parse_id(getattr(self, name))
        assert found is not None, "the setting's rule holds"
        return found


@cache
def _messages() -> Mapping[CanId, str]:
    text = files("contract").joinpath("stillwake.dbc").read_text(encoding="utf-8")
    found = ((int(number), name) for number, name in re.findall(r"^BO_ (\d+) (\w+)", text, re.MULTILINE))
    return {CanId(number & MOST_EXTENDED, bool(number >> 31)): f"{name} in the DBC" for number, name in found}
