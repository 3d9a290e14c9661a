"""The identifiers of diagnosis and calibration that settings have by default, as numbers of their own."""

from typing import Final

REQUEST_ID: Final = 0x7E0
RESPONSE_ID: Final = 0x7E8
COMMAND_ID: Final = 0x7D0
XCP_RESPONSE_ID: Final = 0x7D8
