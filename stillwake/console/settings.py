"""Settings as a command takes them: the release's, a TOML file and `--set` on top, and none that it would ignore."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from contract.config.loading import Loaded, load
from contract.config.tree import Config
from contract.errors import ConfigError
from stillwake.console.terminal import console

_FRAMES: Final = ("bus.interface", "bus.channel", "bus.nominal_bitrate", "bus.data_bitrate", "bus.frames")
DIAGNOSIS: Final = "bus.diagnosis"
TESTERS_BUS: Final = (*_FRAMES, DIAGNOSIS)
"""What a tester on a real bus reads of it."""
REAL_BUS: Final = (*_FRAMES, "bus.e2e")
"""What a node on a real bus reads of it, without the key."""
WEIGHTS: Final = "mpc.weights"
"""The section that a released controller takes as an input."""


def settings(
    verb: str, file: Path | None, overrides: Sequence[str], *, uses: Sequence[str], base: Config | None = None
) -> Loaded:
    """The settings of one call of a command.

    An override that the command does not use is refused. A file may serve several commands: what this one does not use
    of it is named in one line. Raises ConfigError as `load` does, or for an override that would have no effect.

    Args:
        file, overrides: as `contract.config.loading.load` has them.
        uses: sections or single settings that the command reads, such as "flow" or "mpc.weights".
        base: what file and overrides go on top of; the release's settings if None.
    """
    loaded = load(file, overrides, base=base)
    unused = sorted(name for name in loaded.in_overrides if not _is_used(name, uses))
    if unused:
        raise ConfigError(f"--set {unused[0]}: `{verb}` does not use it; it uses {', '.join(sorted(uses))}")
    idle = sorted(name for name in loaded.in_file if not _is_used(name, uses))
    if idle:
        console.print(f"{file}: `{verb}` does not use {', '.join(idle)}")
    return loaded


def _is_used(name: str, uses: Sequence[str]) -> bool:
    return any(name == used or name.startswith(f"{used}.") for used in uses)
