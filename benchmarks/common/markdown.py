"""Tables in Markdown, made from the files in `results/`."""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

END: Final = "<!-- end -->"
_START: Final = re.compile(r"^<!-- table (\w+) -->$", re.MULTILINE)


def read(path: Path) -> Any:
    """Read a results file."""
    return json.loads(path.read_text(encoding="utf-8"))


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    lines += ["| " + " | ".join(_cell(value) for value in row) + " |" for row in rows]
    return "\n".join(lines)


def names(text: str) -> list[str]:
    """Return the names of the tables that a page contains, in the order of the page."""
    return _START.findall(text)


def fill(text: str, tables: Mapping[str, str]) -> str:
    """Return a page in which the text between each `<!-- table NAME -->` and `<!-- end -->` is replaced by the table of
    this name. Raises ValueError if `tables` lacks a name of the page, or if an end is missing."""
    for name in names(text):
        if name not in tables:
            raise ValueError(f"no table {name!r}: one of {', '.join(sorted(tables))}")
        start = f"<!-- table {name} -->\n"
        head, _, rest = text.partition(start)
        if END not in rest:
            raise ValueError(f"the place for the table {name!r} has no {END!r}: write it below the table")
        text = f"{head}{start}{tables[name]}\n{rest[rest.index(END) :]}"
    return text


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
