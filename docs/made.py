"""What is made from the sources on the pages of `docs/reference`: the site has it, the committed files have not.

A page is committed as its text, with a place for each part that is made, `<!-- made NAME -->`. A file on a
source-hosting site is that text alone; it names the command that prints the rest.
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
    """The text of a page with what is made in its places; an unknown name is a KeyError."""
    return PLACE.sub(lambda found: _made(found[1]), text)


@cache
def _made(name: str) -> str:
    return PARTS[name]()
