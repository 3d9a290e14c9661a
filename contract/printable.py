"""The formatting of texts of unknown origin, whose control characters could disturb a terminal."""

from typing import Final

MAX_NAME: Final = 100
"""Largest number of characters in the name of a release, a sensor or a file, so that it fits into one line."""
MAX_SHOWN: Final = 200


def is_name(text: str) -> bool:
    """Return whether a text can be a name: one short line without control characters or lone surrogates."""
    return 0 < len(text) <= MAX_NAME and text.isprintable()


def shown(value: object, most: int = MAX_SHOWN) -> str:
    """Format a value for a message: one line of about `most` characters; unprintable characters become escapes."""
    text = str(value)
    cut = text if len(text) <= most else f"{text[:most]}.."
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in cut)


def quoted(value: object, most: int = MAX_SHOWN) -> str:
    """Format a value as `repr` does, for a one-line message. Python refuses to format an integer of 5,000 digits."""
    if isinstance(value, int) and abs(value) >= 2**63:
        return "a number of more than 18 digits"
    return shown(repr(value), most)
