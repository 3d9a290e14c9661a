"""Tables in Markdown, made of the files in `results/`."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

END: Final = "<!-- end -->"


def read(path: Path) -> Any:
    """A result file."""
    return json.loads(path.read_text(encoding="utf-8"))


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    lines += ["| " + " | ".join(_cell(value) for value in row) + " |" for row in rows]
    return "\n".join(lines)


def fill(text: str, tables: Mapping[str, str]) -> str:
    """A page with what stands between `<!-- table NAME -->` and `<!-- end -->` replaced.

    Raises:
        ValueError: if a table has no place on the page.
    """
    for name, content in tables.items():
        start = f"<!-- table {name} -->\n"
        head, found, rest = text.partition(start)
        if not found:
            raise ValueError(f"no place for the table {name!r}")
        text = f"{head}{start}{content}\n{rest[rest.index(END) :]}"
    return text


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
