"""The documents' tables in Markdown and the documents' pictures, both made from the files in `results/`."""

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from matplotlib.figure import Figure

from benchmarks.common.command_line import ROOT
from contract.atomic import replacing

PICTURES: Final = ROOT / "docs" / "pictures"
SOURCE: Final = "Source"
"""Name of the text field in a PNG that identifies the results file from which the picture was drawn."""
STAMP: Final = "made"
"""Name of the entry in a results file that states the release and the C sources of the figures."""


def draw(figures: Mapping[str, Figure], source: Path) -> None:
    """Write figures that were drawn from one results file; `figures` maps file names to figures."""
    for name, figure in figures.items():
        with replacing(PICTURES / f"{name}.png") as temporary:
            figure.savefig(temporary, format="png", metadata={SOURCE: source_text(source)})


def source_text(source: Path) -> str:
    """Return the text that identifies a picture's results file: its path in the project and its SHA-256. The hash
    leaves out the stamp, because `benchmarks.full` adds the stamp after all pictures and tables were made."""
    place = source.relative_to(ROOT).as_posix() if source.is_relative_to(ROOT) else source.name
    content = json.loads(source.read_text(encoding="utf-8"))
    content["facts"].pop(STAMP, None)
    written = json.dumps(content, indent=2) + "\n"
    return f"{place} {hashlib.sha256(written.encode()).hexdigest()}"


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
            raise ValueError(f"no table {name!r}: must be one of {', '.join(sorted(tables))}")
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
