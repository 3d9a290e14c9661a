"""One run of a campaign as a value that any process can compute, and its hash."""

import hashlib
import json
from dataclasses import dataclass
from typing import Any, Final

from contract.config import loading
from contract.config.tree import Config
from contract.errors import ConfigError
from firmware_sim.bench.spans import Spans
from firmware_sim.campaign.scenario import Scenario

SETTINGS: Final = ("operating_point", "bus", "ecu", "vehicle")
"""Sections that a scenario may set: the controller and the clock of the flow are the release's."""
MARGIN: Final = 2
"""Periods without control beyond the controller's window: the first frame only starts the end-to-end check."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """One run.

    Attributes:
        name: of its file: scenario and phase.
        controlled: whether control is requested; otherwise the flow runs by itself.
        phase: number of the start.
    """

    name: str
    disturb: tuple[str, ...]
    config: Config
    controlled: bool
    phase: int
    seed: int
    timing: Spans

    def key(self, bundle_digest: str, start_digest: str, version: str) -> str:
        """Hash of everything that decides the run, in hex."""
        deciding: dict[str, Any] = {
            "disturb": list(self.disturb),
            "config": loading.to_tree(self.config),
            "controlled": self.controlled,
            "seed": self.seed,
            "timing": [self.timing.lead_in, self.timing.controlled, self.timing.settle],
            "bundle": bundle_digest,
            "start": start_digest,
            "version": version,
        }
        return hashlib.sha256(json.dumps(deciding, sort_keys=True).encode()).hexdigest()


def settings_of(scenario: Scenario, config: Config) -> Config:
    """The campaign's settings with the scenario's on top. Raises ConfigError naming the scenario, for a setting that is
    not there, wrong, or not a scenario's to change."""
    try:
        loaded = loading.load(None, scenario.settings, base=config)
    except ConfigError as error:
        raise ConfigError(f"scenario {scenario.name!r}: {error}") from error
    for name in sorted(loaded.in_overrides):
        if name.partition(".")[0] not in SETTINGS:
            raise ConfigError(
                f"scenario {scenario.name!r}: {name}: a scenario may set {', '.join(SETTINGS)}; give --set for all runs"
            )
    return loaded.config


def seed_of(seed: int, name: str, phase: int) -> int:
    """A seed of its own for every run, whatever else is run."""
    text = f"{seed}/{name}/{phase}"
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4])
