"""The generated parts of the pages in `docs/reference`, which only the site contains.

A committed page marks the place of each generated part by `<!-- made NAME -->`, and states that only the pages of
`make docs` have these parts.
"""

import re
from functools import cache
from typing import Final

from docs import can_messages, command_line, diagnosis, settings, states

PLACE: Final = re.compile(r"<!-- made (\w+) -->")


@cache
def parts() -> dict[str, str]:
    """Return the text of every generated part by its name."""
    return can_messages.parts() | command_line.parts() | diagnosis.parts() | settings.parts() | states.parts()


def whole(text: str) -> str:
    """Return a page with the generated parts in their places. Raises KeyError for an unknown name."""
    return PLACE.sub(lambda found: parts()[found[1]], text)
