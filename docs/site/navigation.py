"""The site's sections, groups and pages, in the order of the lists in `docs/README.md`."""

import re
from typing import Final, NamedTuple

_LINK: Final = re.compile(r"\]\(([^)#\s]+)")


class Group(NamedTuple):
    """A group of pages in a section: its heading ("" for pages that are directly in the section), the Markdown below
    the heading, and the links in the group's lists, in the same order."""

    name: str
    text: str
    pages: tuple[str, ...]


class Section(NamedTuple):
    name: str
    groups: tuple[Group, ...]


def sections(readme: str) -> list[Section]:
    """Return all sections that contain a list. Only links in lists count as pages."""
    found = []
    for section in re.split(r"^## ", readme, flags=re.MULTILINE)[1:]:
        name, _, body = section.partition("\n")
        texts = re.split(r"^### (.+)$", body, flags=re.MULTILINE)
        made = (_group(*one) for one in zip(["", *texts[1::2]], texts[::2], strict=True))
        if groups := tuple(group for group in made if group.pages):
            found.append(Section(name, groups))
    return found


def _group(name: str, text: str) -> Group:
    lists = f"\n{text}".partition("\n- ")[2]
    return Group(name, text.strip(), tuple(_LINK.findall(lists)))
