"""Text from a bundle that may stand on a terminal: it comes from anyone, and a terminal obeys what it is sent."""

from typing import Final

MAX_NAME: Final = 100
"""Characters of a name: of a release, a sensor or a file. It has to stand in one line."""
_MAX_SHOWN: Final = 200


def is_name(text: str) -> bool:
    """Whether this can name something: one short line without control characters or lone surrogates."""
    return 0 < len(text) <= MAX_NAME and text.isprintable()


def shown(value: object) -> str:
    """A value, for a message: in one short line, what cannot be printed as escapes."""
    text = str(value)
    cut = text if len(text) <= _MAX_SHOWN else f"{text[:_MAX_SHOWN]}.."
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode() for character in cut
    )


def quoted(value: object) -> str:
    """A value as Python writes it, for a message: in one short line."""
    return shown(repr(value))
