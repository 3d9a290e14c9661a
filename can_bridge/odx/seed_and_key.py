"""The rule by which a key is computed from a seed, as JSON, for authors of a tester or of a seed-and-key library."""

import json
from typing import Any, Final

from can_bridge.flashing.state import Level
from can_bridge.uds.security import ANSWER_LENGTH, DELAY_NS, LABEL, MAX_ATTEMPTS, SEED_LENGTH, AccessKey
from can_bridge.uds.services import LEVELS

SEED_AND_KEY: Final = "seed_and_key.json"
EXAMPLE: Final = bytes(range(16))
"""The bytes of both the access key and the seed in each known answer. No ECU uses this access key."""
_LIBRARY: Final = {
    "function": "GenerateKeyEx",
    "prototype": "int GenerateKeyEx(const unsigned char *seed, unsigned int seed_length, unsigned int level, "
    "const char *variant, unsigned char *key, unsigned int key_capacity, unsigned int *key_length)",
    "level": "number of the level below",
    "variant": "not used: the library's maker keeps an access key for each ECU",
    "returns": {"0": "key computed", "1": "key_capacity too small", "2": "level unknown", "4": "other error"},
}
"""The interface of the seed-and-key library that testers load. Tools for Windows expect a DLL with this function."""


def seed_and_key() -> bytes:
    """Return the description as JSON; it contains no secret."""
    example = AccessKey(EXAMPLE)

    def level(one: Level) -> dict[str, Any]:
        return {
            "name": one.name.lower(),
            "level": int(one),
            "request_seed": f"27 {one:02X}",
            "send_key": f"27 {one + 1:02X}",
            "sessions": sorted(f"10 {session:02X}" for session in LEVELS[one].sessions),
            "known_answer": {
                "access_key": EXAMPLE.hex(),
                "seed": EXAMPLE.hex(),
                "key": example.answer(one, EXAMPLE).hex(),
            },
        }

    described = {
        "algorithm": "AES-CMAC (RFC 4493) with keys of 128 bits",
        "level_key": "AES-CMAC(access key, label followed by the level in one byte)",
        "key": "AES-CMAC(level_key, seed)",
        "label_hex": LABEL.hex(),
        "access_key_bytes": len(EXAMPLE),
        "seed_bytes": SEED_LENGTH,
        "key_bytes": ANSWER_LENGTH,
        "seed_of_zeros": "the level is unlocked already: send no key",
        "attempts": MAX_ATTEMPTS,
        "delay_s": DELAY_NS / 1e9,
        "levels": [level(one) for one in Level],
        "library": _LIBRARY,
    }
    return (json.dumps(described, indent=2) + "\n").encode()
