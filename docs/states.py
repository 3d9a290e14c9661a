"""The tables and the picture of `docs/reference/states.md`, from the ECU's table of transitions: `make generated`.

This module has the positions of the boxes and lines in the picture. The number on a line is the number of a row in the
table. A transition without a line, or a line without a transition, is an error.
"""

import sys
from html import escape
from pathlib import Path
from typing import Final, NamedTuple

from contract.config.vehicle import EcuConfig
from docs.site import source
from docs.table import table
from ecu import fail_safe
from ecu.fail_safe import TRANSITIONS, OperatingMode

PICTURE: Final = Path(__file__).with_name("states.svg")

WIDTH, HEIGHT = 1000, 600
INK, LINE = "#17202b", "#5b6b7d"
BOX: Final = (124, 46)
"""Width and height of a state's box in px."""
STATES: Final = {
    "INIT": (60, 75),
    "STANDBY": (60, 195),
    "ARMED": (60, 330),
    "WARMUP": (365, 95),
    "CONTROL": (750, 95),
    "HOLD": (750, 222),
    "DECAY": (750, 340),
    "FAULT": (440, 510),
    "UPDATE": (40, 510),
}
"""Upper left corners of the states' boxes."""
GROUPS: Final = (
    ("no accepted request", (30, 40, 190, 360), "#eef4e8"),
    ("accepted request", (330, 40, 615, 360), "#e6edf6"),
    ("jets may run", (700, 70, 225, 325), "#fdf2df"),
)
"""Rectangles (x, y, width, height) around several states. A line from a rectangle's edge begins at all states in the
rectangle."""
UNWANTED, WANTED = "INIT STANDBY ARMED", "WARMUP CONTROL HOLD DECAY"
CHOICE: Final = (560, 245)
"""Middle of the diamond. It is not a state: lines from ARMED and from an accepted request branch there."""


class Line(NamedTuple):
    """A line from one or several states to a state in the picture, with the line's corners and its label's middle."""

    start: str
    to: str
    corners: tuple[tuple[int, int], ...]
    label: tuple[int, int]


LINES: Final = (
    Line("INIT", "STANDBY", ((122, 121), (122, 195)), (122, 154)),
    Line("INIT", "ARMED", ((60, 98), (44, 98), (44, 353), (60, 353)), (44, 270)),
    Line("STANDBY", "ARMED", ((122, 241), (122, 330)), (122, 280)),
    Line("INIT", "WARMUP", ((184, 105), (365, 105)), (270, 105)),
    Line("ARMED CONTROL HOLD DECAY", "WARMUP", ((560, 211), (560, 130), (489, 130)), (560, 170)),
    Line("ARMED WARMUP HOLD DECAY", "CONTROL", ((577, 228), (640, 228), (640, 118), (750, 118)), (640, 165)),
    Line("ARMED WARMUP CONTROL", "HOLD", ((594, 245), (750, 245)), (670, 245)),
    Line("ARMED WARMUP CONTROL HOLD", "DECAY", ((577, 262), (640, 262), (640, 363), (750, 363)), (640, 325)),
    Line(WANTED, "ARMED", ((330, 368), (184, 368)), (258, 368)),
    Line(WANTED, "FAULT", ((530, 400), (530, 510)), (530, 455)),
    Line(UNWANTED, "FAULT", ((200, 400), (200, 522), (440, 522)), (330, 522)),
    Line(UNWANTED, "UPDATE", ((80, 400), (80, 510)), (80, 450)),
    Line("WARMUP", "UPDATE", ((385, 141), (385, 470), (130, 470), (130, 510)), (280, 470)),
    Line("FAULT", "UPDATE", ((440, 546), (164, 546)), (300, 548)),
    Line("FAULT", "WARMUP", ((465, 510), (465, 300), (420, 300), (420, 141)), (465, 425)),
    Line("FAULT", "CONTROL", ((564, 533), (968, 533), (968, 118), (874, 118)), (760, 533)),
)


def states() -> str:
    """Return a line of the page for each state, with the state's docstring from the source."""
    members = source.read(Path(fail_safe.__file__), fail_safe.__name__).members
    (found,) = (one for one in members if one.name == OperatingMode.__name__)
    of_modes = [one for one in found.members if one.kind == "attribute"]
    texts = {OperatingMode[one.name]: " ".join(one.docstring.split()) for one in of_modes}
    return "\n".join(
        f"- {mode.name} ({mode.on_wire.name}, jets {'may run' if mode.drives_jets else 'shut'}): {text}"
        for mode, text in texts.items()
    )


def transitions() -> str:
    """Return a numbered row for each transition of the ECU's table."""
    rows = (
        (f"{number}: {_names(row.start)}", f"{row.when.text}{_within(row.within)}", f"{row.to.name}: {row.reason.text}")
        for number, row in enumerate(TRANSITIONS, start=1)
    )
    return table(("row: from", "when", "to: Reason on the wire"), rows)


def _names(start: frozenset[OperatingMode]) -> str:
    """Return the states' names; if at most three states are missing, "all but" the names of these."""
    names, others = ([mode.name for mode in OperatingMode if (mode in start) is inside] for inside in (True, False))
    return f"all but {', '.join(others)}" if len(others) <= 3 < len(names) else ", ".join(names)


def _within(periods: str) -> str:
    """Return the number of periods after which the ECU reacts, with settings in code style; "" for the same period."""
    words = (f"`{word}`" if word.isidentifier() else word for word in periods.split())
    return "" if periods == "1" else f"; for {' '.join(words)} periods"


def _rows_on(line: Line) -> list[int]:
    start = {OperatingMode[name] for name in line.start.split()}
    rows = enumerate(TRANSITIONS, start=1)
    return [number for number, row in rows if row.to.name == line.to and not start.isdisjoint(row.start)]


def draw() -> str:
    """Return the picture as SVG. Raises ValueError if a transition has no line, or a line has no transition."""
    there = {(mode.name, row.to.name) for row in TRANSITIONS for mode in row.start if mode is not row.to}
    drawn = {(name, line.to) for line in LINES for name in line.start.split()}
    if there != drawn:
        raise ValueError(f"lines of docs/states.py: missing {sorted(there - drawn)}, too many {sorted(drawn - there)}")
    x, y = CHOICE
    parts = [_group(*group) for group in GROUPS]
    parts += [
        _path(((184, 340), (300, 340), (300, y), (x - 34, y))),
        _path(((x, 345), (x, y + 34))),
        f'<path d="M{x - 34} {y} L{x} {y - 34} L{x + 34} {y} L{x} {y + 34} z" fill="white" stroke="{LINE}"/>',
        _text(x, 362, "each period while", 13),
        _text(x, 378, "the request is high", 13),
        _text(268, 330, "rises", 13),
    ]
    parts += [_path(line.corners) for line in LINES]
    parts += [_label(line.label, _ranges(_rows_on(line))) for line in LINES]
    parts += [_state(name, *corner) for name, corner in STATES.items()]
    return f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" \
font-family="system-ui, 'Segoe UI', Helvetica, Arial, sans-serif" fill="{INK}">
<defs><marker id="tip" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="8" markerHeight="8" orient="auto">\
<path d="M0 0 L10 5 L0 10 z" fill="{LINE}"/></marker></defs>
<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>
{chr(10).join(parts)}
</svg>
"""


def _ranges(numbers: list[int]) -> str:
    """Return numbers as ranges. For example, 1, 2, 3, 5 become "1-3, 5"."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and parts[-1][-1] == number - 1:
            parts[-1].append(number)
        else:
            parts.append([number])
    return ", ".join(f"{part[0]}-{part[-1]}" if len(part) > 1 else str(part[0]) for part in parts)


def _group(name: str, place: tuple[int, int, int, int], fill: str) -> str:
    x, y, width, height = place
    box = f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="10" fill="{fill}" stroke="#b9c4d0"/>'
    return box + _text(x + 12, y + 20, name, 13.5, anchor="start")


def _state(name: str, x: int, y: int) -> str:
    width, height = BOX
    box = f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="8" fill="white" stroke="{LINE}"'
    return f'{box} stroke-width="1.4"/>' + _text(x + width // 2, y + 29, name, 16, weight=600)


def _path(corners: tuple[tuple[int, int], ...]) -> str:
    points = " L".join(f"{x} {y}" for x, y in corners)
    return f'<path d="M{points}" fill="none" stroke="{LINE}" stroke-width="1.5" marker-end="url(#tip)"/>'


def _label(middle: tuple[int, int], text: str) -> str:
    x, y = middle
    width = 16 + 7.5 * len(text)
    box = f'<rect x="{x - width / 2:g}" y="{y - 11}" width="{width:g}" height="22" rx="11" fill="white"'
    return f'{box} stroke="{LINE}"/>' + _text(x, y + 5, text, 13.5)


def _text(x: int, y: int, text: str, size: float, *, anchor: str = "middle", weight: int = 400) -> str:
    style = f'font-size="{size:g}" font-weight="{weight}" text-anchor="{anchor}"'
    return f'<text x="{x}" y="{y}" {style}>{escape(text)}</text>'


_CONFIG: Final = EcuConfig()
STATED: Final = (
    f"**{_CONFIG.loss_limit - 1} of any {_CONFIG.loss_window} periods**",
    f"**{_CONFIG.hold_periods + _CONFIG.decay_periods} in a row**",
)
"""Phrases of the page that contain numbers from the code. A test checks that the page has these phrases."""


def parts() -> dict[str, str]:
    """Return the generated parts of the page by their names."""
    return {"states": states(), "transitions": transitions()}


if __name__ == "__main__":
    PICTURE.write_text(draw(), encoding="utf-8")
    sys.stdout.write(f"wrote {PICTURE}\n")
