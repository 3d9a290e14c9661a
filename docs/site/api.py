"""The API's pages from the docstrings: a page for every folder that has modules, with a section for every module.

The docstrings are read from the source (`docs.site.source`). Sphinx's autodoc would import every module and evaluate
every signature, which takes three times as long, and would not show types as in the source.
"""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import indent
from typing import Any, Final

from sphinx.application import Sphinx
from sphinx.config import Config
from sphinx.ext.napoleon import Config as DocstringConfig
from sphinx.ext.napoleon.docstring import GoogleDocstring

from docs.site import pages, source

FOLDER: Final = pages.GENERATED / "api"

_BAR: Final = re.compile(r"(?<!\\)\|")
_SECTIONS: Final[Any] = DocstringConfig(napoleon_numpy_docstring=False, napoleon_use_ivar=True)

_HEAD: Final = """API
===

For readers who call stillwake from Python: every public module, class and function, by package. :doc:`/architecture`
states which packages each package may import.
"""


def folders() -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield every package, and the names of the public modules in its folder."""
    for package in source.PACKAGES:
        for path in sorted((pages.ROOT / package).rglob("__init__.py")):
            modules = tuple(sorted(one.stem for one in path.parent.glob("*.py") if not one.name.startswith("_")))
            if modules or path.parent.parent == pages.ROOT:
                yield ".".join(path.parent.relative_to(pages.ROOT).parts), modules


def texts() -> dict[Path, str]:
    """Return the text of every page of the API by the path of the page's file."""
    made = {FOLDER / f"{package}.rst": _page(package, modules) for package, modules in folders()}
    for package in source.PACKAGES:
        made[FOLDER / f"{package}.rst"] += _toctree([name for name, _ in folders() if name.startswith(f"{package}.")])
    return made | {FOLDER / "index.rst": _HEAD + _toctree(source.PACKAGES)}


def _page(package: str, modules: Sequence[str]) -> str:
    path = pages.ROOT.joinpath(*package.split("."))
    head = source.read(path / "__init__.py", package).docstring
    parts = [f"{package}\n{'=' * len(package)}\n\n.. py:module:: {package}\n\n{_text(head)}"]
    for name in modules:
        full = f"{package}.{name}"
        found = source.read(path / f"{name}.py", full)
        file = f".. container:: source\n\n   :file:`{full.replace('.', '/')}.py`"
        parts.append(f"{name}\n{'-' * len(name)}\n\n.. py:module:: {full}\n\n{file}\n\n{_text(found.docstring)}")
        parts += [_member(member, "") for member in found.members]
    return "\n\n".join(parts) + "\n"


def _member(member: source.Member, prefix: str) -> str:
    head = f".. py:{member.kind}:: {prefix}{member.name}{member.signature}"
    inner = [_text(member.docstring), *(_member(one, f"{prefix}{member.name}.") for one in member.members)]
    body = "\n\n".join(filter(None, inner))
    return "\n".join([head, *(f"   {option}" for option in member.options), "", indent(body, "   ")])


def _text(docstring: str) -> str:
    """Return a docstring as reStructuredText, with its sections as fields."""
    return str(GoogleDocstring(restructured(docstring.splitlines()), _SECTIONS)).strip("\n")


def restructured(lines: Sequence[str]) -> list[str]:
    """Return a docstring's lines as reStructuredText.

    An indented block after a blank line becomes a literal block. Vertical bars, as in absolute values, are escaped.
    """
    made: list[str] = []
    is_block, before = False, "-"
    for line in lines:
        if line.strip():
            is_first = made[-1:] == [""] and line.startswith("    ") and not before.startswith((" ", "-", ".."))
            if is_first and not is_block:
                made += ["::", ""]
            is_block = line.startswith("    ") and (is_block or is_first)
            before = line
        made.append(line if is_block else _BAR.sub(r"\\|", line))
    return made


def _toctree(names: Sequence[str]) -> str:
    return "\n.. toctree::\n   :maxdepth: 1\n\n" + "".join(f"   {name}\n" for name in names) if names else ""


def setup(app: Sphinx) -> dict[str, Any]:
    """Register `_write`, which writes the pages after Sphinx has read the configuration."""
    app.connect("config-inited", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _write(app: Sphinx, config: Config) -> None:
    made = texts()
    for stale in {*FOLDER.glob("*.rst")} - made.keys():
        stale.unlink()
    pages.write(made)
