"""Which names of Python are the project's own."""

from typing import Final

PACKAGES: Final = ("contract", "wake", "train", "export", "can_bridge", "ecu", "firmware_sim")
"""Those that the API documents, from the one that all import upwards."""


def is_ours(name: str) -> bool:
    """Whether a dotted name begins with one of our packages."""
    return name.partition(".")[0] in PACKAGES
