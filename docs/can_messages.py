"""Write `docs/reference/can-messages.md` from `contract/stillwake.dbc`: `make generated`."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from cantools.database import Database
from cantools.database.can import Message
from cantools.database.can.signal import Signal

from can_bridge.wire.message_sets import SETS, MessageSet

ROOT: Final = Path(__file__).resolve().parents[1]
DBC: Final = ROOT / "contract" / "stillwake.dbc"
PAGE: Final = ROOT / "docs" / "reference" / "can-messages.md"

_HEAD: Final = """# CAN messages

For ECU and validation engineers who read or write the bus. `make generated` writes this page from
[stillwake.dbc](../../contract/stillwake.dbc), which defines everything on it; open that file in your own tool.
A bus carries one of the three sets: `bus.frames` chooses CAN FD or classic CAN, `bus.key` the authenticated form of
CAN FD. Identifiers differ between the sets, so a node of another set is seen and not misread. Those of diagnosis and
calibration are not in the file: they are [settings](diagnosis.md#identifiers-on-the-bus), and never one of these.

{comment}

Bits are given as start and length; the start is the least significant bit of a little-endian signal, and the most
significant one where the table has big-endian. Every message is sent once in a control period,
20 ms for the default vehicle.
The E2E data ID is not sent, it is mixed into the CRC; profile 2 takes it for all 16 entries of its list.
[Protection](../explanation/protection.md) explains what the header and the authentication code are good for."""


def page() -> str:
    """The whole page: the sets, then every message."""
    dbc = Database()
    dbc.add_dbc_string(DBC.read_text(encoding="utf-8"))
    parts = [_HEAD.format(comment=_comment())]
    for messages in SETS:
        parts.append(f"\n## {messages.name[0].upper() + messages.name[1:]}\n")
        parts.append(_set_table(dbc, messages))
        parts += [_message(dbc.get_message_by_name(spec.name)) for spec in messages.specs]
    parts += ["\n## Tables\n", *map(_value_table, ("Mode", "Reason"), (dbc, dbc))]
    return "\n".join(parts) + "\n"


def _comment() -> str:
    # cantools keeps the comments of nodes, messages and signals, but not the file's own.
    text = DBC.read_text(encoding="utf-8")
    begin = text.index('CM_ "') + len('CM_ "')
    return text[begin : text.index('";', begin)]


def _set_table(dbc: Database, messages: MessageSet) -> str:
    lines = ["| id | message | bytes | frame | from | cycle | E2E profile, data ID |", "|---|---|---|---|---|---|---|"]
    for spec in messages.specs:
        message = dbc.get_message_by_name(spec.name)
        kind = "CAN FD, 2 rates" if message.is_fd else "classic"
        attributes = {} if message.dbc is None else message.dbc.attributes
        profile, data_id = (attributes[name].value for name in ("E2EProfile", "E2EDataID"))
        lines.append(
            f"| {message.frame_id:#x} | {message.name} | {message.length} | {kind} | {', '.join(message.senders)} "
            f"| {message.cycle_time} ms | {profile}, {data_id:#x} |"
        )
    return "\n".join(lines)


def _message(message: Message) -> str:
    lines = [
        f"\n### {message.name}\n",
        f"{message.comment}\n",
        "| signal | bits | type | one step | range | meaning |",
        "|---|---|---|---|---|---|",
    ]
    return "\n".join([*lines, *map(_signal, message.signals)])


def _signal(signal: Signal) -> str:
    order = "" if signal.byte_order == "little_endian" else ", big-endian"
    kind = f"{'int' if signal.is_signed else 'uint'}{signal.length}"
    unit = f" {signal.unit}" if signal.unit else ""
    step = f"{signal.scale:g}{unit}" if unit or signal.scale != 1 else ""
    table = signal.name in ("Mode", "State", "Reason")
    limits = "table" if table else f"{signal.minimum} .. {signal.maximum}"
    meaning = (
        signal.comment
        or {"E2E_CRC": "E2E checksum.", "E2E_Counter": "E2E counter, one more in every frame."}[signal.name]
    )
    return f"| `{signal.name}` | {signal.start}, {signal.length}{order} | {kind} | {step} | {limits} | {meaning} |"


def _value_table(name: str, dbc: Database) -> str:
    message, signal = {"Mode": ("JetCommand", "Mode"), "Reason": ("EcuStatus", "Reason")}[name]
    choices: Mapping[int, object] = dbc.get_message_by_name(message).get_signal_by_name(signal).choices or {}
    rows = [f"| {value} | {text} |" for value, text in sorted(choices.items())]
    return "\n".join(
        [f"`{name}`{' (also `State`)' if name == 'Mode' else ''}\n", "| value | name |", "|---|---|", *rows, ""]
    )


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    sys.stdout.write(f"wrote {PAGE}\n")
