"""What a C library's generated header says about it, and what follows from its sizes."""

import re
from collections.abc import Mapping
from typing import Final

from contract.errors import McuError

SETTINGS: Final = "sw_settings.h"
TERMS: Final = 7
_DEFINITION: Final = re.compile(r"^#define (SW_\w+) (\S.*)$", re.MULTILINE)


class Settings:
    """The header's definitions; raises McuError for one that is missing."""

    def __init__(self, header: bytes) -> None:
        self._found: dict[str, str] = dict(_DEFINITION.findall(header.decode()))

    @classmethod
    def of(cls, sources: Mapping[str, bytes]) -> "Settings":
        """Those of a library's files; raises McuError if the header is not among them."""
        if SETTINGS not in sources:
            raise McuError(f"{SETTINGS} is missing: this is no folder written by `stillwake export --c`")
        return cls(sources[SETTINGS])

    def text(self, name: str) -> str:
        if name not in self._found:
            raise McuError(f"{SETTINGS}: {name} is missing")
        return self._found[name].strip('"')

    def number(self, name: str) -> int:
        return int(self.text(name))

    def multiply_accumulates(self) -> int:
        """Products of weights in a control step, by the networks' sizes: one forward pass more than adjoints."""
        sizes = {
            name: self.number(f"SW_{name}")
            for name in ("WINDOW", "SENSORS", "LSTM", "HEAD", "LATENT", "DYN1", "DYN2", "DECODER", "BLOCKS")
        }
        latent, lstm, decoder = sizes["LATENT"], sizes["LSTM"], sizes["DECODER"]
        encoder = sizes["WINDOW"] * 4 * lstm * (sizes["SENSORS"] + 1 + lstm) + sizes["HEAD"] * (lstm + latent)
        dynamics = sizes["DYN1"] * (latent + 1) + sizes["DYN2"] * (sizes["DYN1"] + latent)
        outputs = decoder * (latent + sizes["BLOCKS"] * decoder + 2)
        passes = 2 * self.number("SW_ITERATIONS") + 1
        return encoder + passes * self.number("SW_HORIZON") * (dynamics + outputs)
