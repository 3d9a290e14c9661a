"""Every road by its name on the command line, and the module in this folder whose `measure` makes its row."""

from typing import Final

ROADS: Final = {
    "no-control": "without",
    "steady": "without",
    "release": "release",
}
