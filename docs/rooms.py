"""Draw `docs/rooms.svg` from the imports in the source: `make generated`.

The picture has a box for each top-level package (room). A box has a label (chip) for each of the package's folders. An
arrow from one room down to another is an import. The arrow's number counts the lower room's modules that the upper
room uses. Each room is on the lowest row (floor) from which all its imports point down, so circular imports are an
error. The boxes leave gaps, so that every arrow is a straight line.
"""

import ast
import re
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping
from functools import cache
from html import escape
from pathlib import Path
from textwrap import wrap
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).resolve().parents[1]
PICTURE: Final = ROOT / "docs" / "rooms.svg"

ROOMS: Final = {
    "stillwake": (0, 3, "the command line: the only package that may import all others"),
    "firmware_sim": (0, 1, "vehicle, closed loop, emulated board, reports"),
    "ecu": (1, 2, "what a vehicle installs, Python and C"),
    "wake": (0, 0, "the plant and its recordings"),
    "can_bridge": (1, 1, "frames, protection, buses, diagnosis, gate"),
    "train": (2, 2, "from the recording to the model"),
    "export": (3, 3, "from the model to ONNX, C and bundle"),
    "contract": (0, 3, "data and formats that packages share: geometry, sensors, units, errors, the DBC"),
}
"""The first and the last of the four columns that each room's box covers, and a text about its content."""
TOP: Final = "stillwake"
"""The room whose arrows are not drawn, because it has an arrow to every other room."""

Uses = Mapping[tuple[str, str], int]
"""The number of modules that a room imports from another room, by the names of the importing and the other room."""

WIDTH, MARGIN, GAP, FLOOR = 960, 20, 44, 60
CHANNEL, APART = 34, 26
"""Free width in px beside a box, for arrows that pass the box; smallest distance in px between two arrows."""
FILL: Final = ("#e6edf6", "#eef4e8", "#fdf2df", "#f2ecf7", "#f7e9e9")
"""Colours of the floors, from the lowest up."""
LETTER = 8.2
"""Assumed width of a letter in px, for text of 14 px. In usual fonts the average width is not greater."""
_NAMES: Final = r"[\w.]+(?: as \w+)?(?:, [\w.]+(?: as \w+)?)*"
_IMPORT: Final = re.compile(rf"^[ \t]*((?:from [\w.]+ )?import (?:\([^)]*\)|{_NAMES}))[ \t]*(?:#.*)?$", re.MULTILINE)
INK, LINE = "#17202b", "#5b6b7d"


class Box(NamedTuple):
    left: float
    right: float
    top: float
    bottom: float


@cache
def imports(root: Path) -> dict[tuple[str, str], int]:
    """Return the number of imported modules, by the names of the importing and the imported room."""
    used: defaultdict[tuple[str, str], set[str]] = defaultdict(set)
    for room in ROOMS:
        for path in sorted((root / room).rglob("*.py")):
            for module in _imported(root, path.read_text(encoding="utf-8")):
                other = module.partition(".")[0]
                if other in ROOMS and other != room:
                    used[room, other].add(module)
    return {pair: len(modules) for pair, modules in sorted(used.items())}


def import_statements(text: str) -> list[ast.stmt]:
    """Return all imports of a Python source, also in functions. Parses only imports, which is thirty times as fast."""
    return ast.parse("\n".join(_IMPORT.findall(text))).body


def _imported(root: Path, text: str) -> Iterator[str]:
    for node in import_statements(text):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            folder = root.joinpath(*node.module.split("."))
            for alias in node.names:
                found = (folder / f"{alias.name}.py").exists() or (folder / alias.name / "__init__.py").exists()
                yield f"{node.module}.{alias.name}" if found else node.module


def floors(uses: Uses) -> dict[str, int]:
    """Return the floor of every room; 0 for rooms that import no other room. Raises ValueError for a circle."""
    floor = dict.fromkeys(ROOMS, 0)
    for _ in ROOMS:
        raised = {room: max([1 + floor[low] for up, low in uses if up == room], default=0) for room in ROOMS}
        if raised == floor:
            return floor
        floor = raised
    circle = [room for room in ROOMS if floor[room] >= len(ROOMS) - 1]
    raise ValueError(f"rooms import each other in a circle: {', '.join(circle or ROOMS)}: remove one of the imports")


def folders(root: Path, room: str) -> list[str]:
    """Return the sub-packages of a room."""
    return sorted(path.parent.name for path in (root / room).glob("*/__init__.py"))


def draw(root: Path = ROOT) -> str:
    """Return the picture as SVG."""
    uses = imports(root)
    floor = floors(uses)
    boxes, height = _boxes(root, floor)
    parts = [_room(root, room, box, FILL[floor[room]]) for room, box in boxes.items()]
    taken: list[tuple[float, float, float]] = []
    drawn = [pair for pair in uses if pair[0] != TOP]
    for upper, lower in sorted(drawn, key=lambda pair: (floor[pair[0]] - floor[pair[1]], pair)):
        x = _free(boxes, upper, lower, taken)
        taken.append((x, boxes[upper].bottom, boxes[lower].top))
        parts.append(_arrow(x, boxes[upper].bottom, boxes[lower].top, uses[upper, lower]))
    legend = f"An arrow is an import; its number counts the imported modules. {TOP} imports all other packages."
    return f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height + 44:.0f}" \
font-family="system-ui, 'Segoe UI', Helvetica, Arial, sans-serif" fill="{INK}">
<defs><marker id="tip" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="8" markerHeight="8" orient="auto">\
<path d="M0 0 L10 5 L0 10 z" fill="{LINE}"/></marker></defs>
<rect width="{WIDTH}" height="{height + 44:.0f}" fill="white"/>
{chr(10).join(parts)}
<text x="{MARGIN}" y="{height + 26:.0f}" font-size="14" fill="{LINE}">{legend}</text>
</svg>
"""


def _boxes(root: Path, floor: Mapping[str, int]) -> tuple[dict[str, Box], float]:
    """Return the boxes, the top floor's boxes first, and the lower edge of the lowest box."""
    column = (WIDTH - 2 * MARGIN - 3 * GAP) / 4
    boxes: dict[str, Box] = {}
    top = float(MARGIN)
    highest = max(floor.values())
    for level in range(highest, -1, -1):
        rooms = [room for room in ROOMS if floor[room] == level]
        bottom = top
        for room in rooms:
            first, last, _ = ROOMS[room]
            left, right = MARGIN + first * (column + GAP), MARGIN + last * (column + GAP) + column
            if 0 < level < highest and first != last:
                left, right = left + CHANNEL, right - CHANNEL
            rows = _chips(folders(root, room), right - left)
            bottom = max(bottom, top + 50 + 18 * len(_lines(room, right - left)) + 30 * len(rows))
            boxes[room] = Box(left, right, top, bottom)
        for room in rooms:
            boxes[room] = boxes[room]._replace(bottom=bottom)
        top = bottom + FLOOR
    return boxes, bottom


def _chips(names: list[str], width: float) -> list[list[tuple[str, float]]]:
    """Return rows of labels that fit into the width, each label with its text and width."""
    rows: list[list[tuple[str, float]]] = []
    used = width
    for name in names:
        chip = LETTER * len(name) + 12
        if used + chip > width - 16:
            rows.append([])
            used = 14.0
        rows[-1].append((name, chip))
        used += chip + 6
    return rows


def _lines(room: str, width: float) -> list[str]:
    return wrap(ROOMS[room][2], int((width - 20) / LETTER))


def _room(root: Path, room: str, box: Box, fill: str) -> str:
    parts = [
        f'<rect x="{box.left:g}" y="{box.top:g}" width="{box.right - box.left:g}" height="{box.bottom - box.top:g}" '
        f'rx="8" fill="{fill}" stroke="{LINE}" stroke-width="1.2"/>',
        f'<text x="{box.left + 14:g}" y="{box.top + 27:g}" font-size="19" font-weight="600">{room}</text>',
    ]
    y = box.top + 49
    for line in _lines(room, box.right - box.left):
        parts.append(f'<text x="{box.left + 14:g}" y="{y:g}" font-size="14">{escape(line)}</text>')
        y += 18
    y -= 5
    for row in _chips(folders(root, room), box.right - box.left):
        x = box.left + 14
        for name, width in row:
            parts.append(
                f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="24" rx="5" fill="white" stroke="#b9c4d0"/>'
                f'<text x="{x + width / 2:g}" y="{y + 16.5:g}" font-size="13.5" text-anchor="middle">{name}</text>'
            )
            x += width + 6
        y += 30
    return "\n".join(parts)


def _free(boxes: Mapping[str, Box], upper: str, lower: str, taken: list[tuple[float, float, float]]) -> float:
    """Return the middle of the widest gap for a straight arrow between two boxes; other boxes and arrows limit gaps.
    Raises ValueError if there is no such gap."""
    a, b = boxes[upper], boxes[lower]
    left, right = max(a.left, b.left), min(a.right, b.right)
    blocked = [(box.left, box.right) for box in boxes.values() if box.top > a.bottom and box.bottom < b.top] + [
        (x - APART / 2, x + APART / 2) for x, top, bottom in taken if top < b.top and bottom > a.bottom
    ]
    gaps, begin = [], left
    for start, stop in sorted(blocked):
        gaps.append((min(start, right) - begin, begin))
        begin = max(begin, stop)
    gaps.append((right - begin, begin))
    width, begin = max(gaps, key=lambda gap: (round(gap[0], 3), -gap[1]))
    if width < APART:
        raise ValueError(f"no gap for an arrow from {upper} to {lower}: change their columns in ROOMS")
    return begin + width / 2


def _arrow(x: float, top: float, bottom: float, count: int) -> str:
    middle = bottom - FLOOR / 2 - 3
    return (
        f'<path d="M{x:g} {top:g} V{bottom - 1:g}" stroke="{LINE}" stroke-width="1.6" marker-end="url(#tip)"/>'
        f'<rect x="{x - 15:g}" y="{middle - 11:g}" width="30" height="22" rx="11" fill="white" stroke="{LINE}"/>'
        f'<text x="{x:g}" y="{middle + 5:g}" font-size="14" text-anchor="middle">{count}</text>'
    )


if __name__ == "__main__":
    PICTURE.write_text(draw(), encoding="utf-8")
    sys.stdout.write(f"wrote {PICTURE}\n")
