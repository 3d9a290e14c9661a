"""The generated parts of the pages in `docs/reference`, which only the site contains.

A committed page marks the place of each generated part by `<!-- made NAME -->`, and states that only the pages of
`make docs` have these parts.
"""

import re
from collections.abc import Callable, Mapping
from functools import cache
from typing import Final

from docs import can_messages, command_line, diagnosis, settings, states

PARTS: Final[Mapping[str, Callable[[], str]]] = {
    **can_messages.PARTS,
    **command_line.PARTS,
    **diagnosis.PARTS,
    **settings.PARTS,
    **states.PARTS,
}
PLACE: Final = re.compile(r"<!-- made (\w+) -->")


def whole(text: str) -> str:
    """Return a page with the generated parts in their places. Raises KeyError for an unknown name."""
    return PLACE.sub(lambda found: _made(found[1]), text)


@cache
def _made(name: str) -> str:
    return PARTS[name]()
