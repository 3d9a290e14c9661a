"""The site's sections, groups and pages, in the order of the lists in `docs/README.md`."""

import re
from dataclasses import dataclass
from typing import Final

_HEADING: Final = re.compile(r"^(##|###) (.+)$")
_BULLET: Final = re.compile(r"^- ")
_LINK: Final = re.compile(r"\]\(([^)#\s]+)")


@dataclass(frozen=True, kw_only=True)
class Group:
    """A group of pages in a section.

    Attributes:
        name: heading of the group; "" for pages that are directly in the section.
        text: the Markdown below the heading.
        pages: the links in the group's lists, in the same order.
    """

    name: str
    text: str
    pages: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Section:
    name: str
    groups: tuple[Group, ...]


def sections(readme: str) -> tuple[Section, ...]:
    """Return all sections that contain a list. Only links in lists count as pages."""
    found: list[tuple[str, list[tuple[str, list[str]]]]] = []
    for line in readme.splitlines():
        heading = _HEADING.match(line)
        if heading is None:
            if found:
                found[-1][1][-1][1].append(line)
        elif heading[1] == "##":
            found.append((heading[2], [("", [])]))
        else:
            found[-1][1].append((heading[2], []))
    made = [Section(name=name, groups=tuple(_groups(groups))) for name, groups in found]
    return tuple(section for section in made if section.groups)


def _groups(groups: list[tuple[str, list[str]]]) -> list[Group]:
    made = [Group(name=name, text="\n".join(lines).strip(), pages=_pages(lines)) for name, lines in groups]
    return [group for group in made if group.pages]


def _pages(lines: list[str]) -> tuple[str, ...]:
    first = next((number for number, line in enumerate(lines) if _BULLET.match(line)), len(lines))
    return tuple(_LINK.findall("\n".join(lines[first:])))
