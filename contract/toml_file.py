"""A reader of users' TOML files: it reads a file as a whole, and reports an error in one line."""

import tomllib
from importlib.resources.abc import Traversable
from typing import Any, Final

from contract.errors import ConfigError

LARGEST_FILE: Final = 2**20
"""Largest size of a file, in bytes; a file with all settings has three thousand bytes."""


def read_toml(source: Traversable, what: str) -> dict[str, Any]:
    """Return the tree of a file. Raises ConfigError, whose message begins with `what`, the kind of the file."""
    try:
        with source.open("rb") as file:
            data = file.read(LARGEST_FILE + 1)
        if len(data) > LARGEST_FILE:
            raise ConfigError(f"{what} {source}: larger than {LARGEST_FILE} bytes")
        return tomllib.loads(data.decode("utf-8-sig"))
    except OSError as error:
        raise ConfigError(f"{what} {source}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{what} {source}: is not UTF-8 text") from error
    except (ValueError, RecursionError) as error:  # tomllib's errors, or that of a NUL in the path
        raise ConfigError(f"{what} {source}: {error}") from error
