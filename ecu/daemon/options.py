"""Options of the ECU's process that are not settings of the ECU."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from can_bridge.secoc.freshness_store import FreshnessStore
from can_bridge.secoc.key import read_key
from can_bridge.secoc.node import Authentication
from contract.config.tree import Config
from contract.errors import ConfigError
from ecu.daemon.reporter import DatedEvent, plain
from ecu.real_time.privileges import Wanted

FRESHNESS: Final = "freshness.json"
"""Name of the file with the freshness values, in the state directory that systemd gives to a service."""


@dataclass(frozen=True, kw_only=True)
class ProcessOptions:
    """Options of one process.

    Attributes:
        spin_ns: see `clock.sleep_until`.
        periods: number of periods after which the process ends; None for no limit.
        stage_times: file to which the times of each period's stages are written at the end.
        metrics: file to which the counters are written for Prometheus.
        freshness: file that stores freshness values over a power cycle, needed with `bus.key`.
        frames: file to which the frames that the ECU sent and accepted are written at the end.
    """

    wanted: Wanted = field(default_factory=Wanted)
    spin_ns: int = 0
    periods: int | None = None
    stage_times: Path | None = None
    metrics: Path | None = None
    freshness: Path | None = None
    frames: Path | None = None
    as_line: Callable[[DatedEvent], str] = plain
    environment: Mapping[str, str] = field(default_factory=lambda: dict(os.environ))


def freshness_file(options: ProcessOptions) -> Path:
    """Return the file that stores freshness values over a power cycle. Raises ConfigError if there is neither the
    option nor systemd's state directory."""
    if options.freshness is not None:
        return options.freshness
    folder = options.environment.get("STATE_DIRECTORY", "").partition(":")[0]
    if not folder:
        raise ConfigError("bus.key: name a file that stores the freshness values with --freshness FILE")
    return Path(folder) / FRESHNESS


def authentication_of(config: Config, options: ProcessOptions) -> tuple[FreshnessStore | None, Authentication | None]:
    """Return the freshness store and the node's authentication data for a new power cycle, or (None, None) without
    `bus.key`. Raises KeyFileError if the key cannot be read; also the errors of `FreshnessStore.begin`."""
    if not config.bus.key:
        return None, None
    key = read_key(Path(config.bus.key))
    store = FreshnessStore(freshness_file(options))
    return store, store.begin(key)
