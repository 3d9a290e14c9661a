"""The lists of `docs/reference/settings.md`, from the tree of settings that `stillwake config` prints."""

import os
import re
from collections import Counter
from typing import Final

from contract.config.listing import Section, Setting, sections, shown
from contract.config.loading import load_config
from contract.config.notes import Source

_SIGNS: Final = {"at least ": "≥", "positive": "", "non-negative": "≥0", "in ": ""}
"""Short forms of the words at the beginning of a bound. The page leaves out "positive"."""


def lists() -> str:
    """Return a heading and a list for every section of settings."""
    return "\n\n".join(map(_section, sections(load_config())))


def _section(section: Section) -> str:
    common, count = Counter(_source(one.source) for one in section.settings).most_common(1)[0]
    origin = f" Source: {common}." if count > 1 and common not in section.meaning else ""
    lines = "\n".join(_line(one, common) for one in section.settings)
    return f"## {section.name}\n\n{section.meaning}{origin}\n\n{lines}"


def _line(one: Setting, common: str) -> str:
    """Return a setting's line. The line has the source, unless the section or the setting's text has it."""
    unit = f" {one.unit}" if one.unit else ""
    bounds = _bounds(one)
    allowed = f" ({bounds})" if bounds else ""
    release = f", release {shown(one.value)}" if one.is_changed else ""
    source = _source(one.source)
    meaning = one.meaning if source == common or source in one.meaning else f"{one.meaning} ({source})"
    return f"- `{one.name}` {shown(one.paper)}{unit}{allowed}{release}{meaning and ': '}{meaning.strip()}"


def _bounds(one: Setting) -> str:
    """Return a setting's bound, without the reason that is in the error message; "" for positive numbers, for text, and
    for bounds of more than six words, which are in the text of the section."""
    bounds = one.bounds.partition(":")[0].partition(", for ")[0]
    if not bounds and isinstance(one.value, int) and not isinstance(one.value, bool):
        return "with others"
    sign = next((sign for sign in _SIGNS if bounds.startswith(sign)), "")
    short = re.sub(f"^{sign}", _SIGNS.get(sign, ""), bounds)
    return "" if short == "≥1" or len(short.split()) > 6 else short


def _source(source: Source) -> str:
    """Return a default's source, with a link to the page that explains the source, or with the reason."""
    if source.page:
        return f"[{source.name}]({os.path.relpath(source.page, 'reference')})"
    return f"{source.name}, {source.note}" if source.kind == "ours" else source.name


def parts() -> dict[str, str]:
    """Return the generated part of the page by its name."""
    return {"settings": lists()}
