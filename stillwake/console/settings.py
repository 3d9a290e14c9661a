"""The settings of a command: the release's settings with the changes of `--set`; a single `--set` that has no effect is
refused."""

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
"""Settings of the bus that a tester on a real bus reads."""
REAL_BUS: Final = (*_FRAMES, "bus.e2e")
"""Settings of the bus, without the key, that a node on a real bus reads."""
VIRTUAL_BUS: Final = (*_FRAMES[2:], "bus.e2e", "bus.key", "bus.background")
"""Settings of the bus that a run in virtual time reads."""
COST_WEIGHTS: Final = "mpc.weights"
"""The section of settings that a released controller reads as an input."""


def read_settings(given: Sequence[str], *, base: Config | None = None) -> Loaded:
    """Read the settings and apply the `--set` texts; one text may be a file. Raises ConfigError as `load` does."""
    files = [text for text in given if "=" not in text and text.endswith(".toml")]
    if len(files) > 1:
        raise ConfigError(f"--set {files[1]} is the second file; give one file, and changes as section.key=value")
    overrides = [text for text in given if text not in files]
    return load(Path(files[0]) if files else None, overrides, base=base)


def settings(verb: str, given: Sequence[str], *, uses: Sequence[str], base: Config | None = None) -> Loaded:
    """Return the settings for one call of a command with the `--set` texts `given`. `uses` are the sections or single
    settings that the command reads, such as "flow" or "mpc.weights"; `base` are the settings that `--set` changes, None
    for the release's settings. A file of settings may be meant for several commands, so its unused settings are only
    listed in one line. Raises ConfigError as `load` does, or for a single setting that would have no effect."""
    loaded = read_settings(given, base=base)
    unused = sorted(name for name in loaded.in_overrides if not _is_used(name, uses))
    if unused:
        raise ConfigError(f"--set {unused[0]}: `{verb}` does not use it; this command uses {', '.join(sorted(uses))}")
    idle = sorted(name for name in loaded.in_file if not _is_used(name, uses))
    if idle:
        (file,) = (text for text in given if "=" not in text)
        console.print(f"{file}: `{verb}` does not use {', '.join(idle)}")
    return loaded


def with_bus(bus: str | None, given: Sequence[str]) -> list[str]:
    """Return the texts of `--set`, with the bus of `--bus` added. Raises ConfigError if the value of `--bus` is not
    INTERFACE:CHANNEL, or if `--set` also sets a bus."""
    if bus is None:
        return list(given)
    interface, colon, channel = bus.partition(":")
    if not (interface and colon and channel):
        raise ConfigError(f"--bus {bus}: must be INTERFACE:CHANNEL, e.g. socketcan:can0 or udp_multicast:239.74.163.2")
    for name in ("bus.interface", "bus.channel"):
        if any(text.partition("=")[0].strip() == name for text in given):
            raise ConfigError(f"--bus {bus}: already sets {name}; leave out --set {name}")
    return [*given, f"bus.interface={interface}", f"bus.channel={channel}"]


def _is_used(name: str, uses: Sequence[str]) -> bool:
    return any(name == used or name.startswith(f"{used}.") for used in uses)
