"""Text from a bundle that may stand on a terminal: it comes from anyone, and a terminal obeys what it is sent."""

from typing import Final

MAX_NAME: Final = 100
"""Characters of a name: of a release, a sensor or a file. It has to stand in one line."""
MAX_SHOWN: Final = 200
LARGEST: Final = 2**63
"""Whole numbers from here on fit no array."""


def is_name(text: str) -> bool:
    """Whether this can name something: one short line without control characters or lone surrogates."""
    return 0 < len(text) <= MAX_NAME and text.isprintable()


def shown(value: object, most: int = MAX_SHOWN) -> str:
    """A value, for a message: one line of about that many characters, what cannot be printed as escapes."""
    text = str(value)
    cut = text if len(text) <= most else f"{text[:most]}.."
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode() for character in cut
    )


def quoted(value: object, most: int = MAX_SHOWN) -> str:
    """A value as Python writes it, for a message of one line; Python writes no whole number of 5,000 digits."""
    if isinstance(value, int) and abs(value) >= LARGEST:
        return "a number of more than 18 digits"
    return shown(repr(value), most)
