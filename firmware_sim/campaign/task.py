"""The data of one run of a campaign, from which any process can execute the run, and the hash of these data."""

import hashlib
import json
from dataclasses import dataclass
from typing import Any, Final

from contract.config import loading
from contract.config.body import BodyConfig
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.errors import ConfigError
from firmware_sim.bench.disturbances import Disturbances
from firmware_sim.bench.spans import Spans
from firmware_sim.campaign.scenario import Scenario

_SETTINGS: Final = ("operating_point", "bus", "ecu", "vehicle", "flow.reynolds", "flow.substeps")
"""Sections and settings that a scenario may change. The release fixes the controller and its period in t_c."""
PlantKey = tuple[FlowConfig, BodyConfig]

MARGIN_PERIODS: Final = 2
"""Number of periods without control that a run needs beyond the length of the controller's window, because the first
frame only starts the end-to-end check."""


@dataclass(frozen=True, kw_only=True)
class RunTask:
    """The data of one run.

    Attributes:
        name: name of the run's file, formed from scenario and phase.
        controlled: whether control is requested; otherwise the flow runs without the loop.
        config: settings, with the plant's body, which may differ from the body of the release.
        phase: index of the starting phase.
    """

    name: str
    disturb: tuple[str, ...]
    config: Config
    controlled: bool
    phase: int
    seed: int
    timing: Spans

    @property
    def plant(self) -> PlantKey:
        """Key under which the initial states of the run's plant are stored."""
        return plant_of(self.config)

    def key(self, bundle_digest: str, start_digest: str, version: str) -> str:
        """Return the hash of everything that the run depends on, in hex."""
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


def plant_of(config: Config) -> PlantKey:
    """Return the settings that a starting state has to match."""
    return config.flow, config.body


def settings_of(scenario: Scenario, config: Config) -> Config:
    """Return the campaign's settings, overridden by the scenario's settings, with the body of the scenario's plant.
    Raises ConfigError if a setting of the scenario is unknown, wrong, or not allowed in a scenario; the error states
    the scenario."""
    try:
        loaded = loading.load(None, scenario.settings, base=config)
        plant = Disturbances.parse(scenario.disturb).plant(loaded.config)
    except ConfigError as error:
        raise ConfigError(f"scenario {scenario.name!r}: {error}") from error
    for name in sorted(loaded.in_overrides):
        if not {name, name.partition(".")[0]} & set(_SETTINGS):
            raise ConfigError(
                f"scenario {scenario.name!r}: {name}: a scenario sets {', '.join(_SETTINGS)}; give --set for all runs"
            )
    return plant


def seed_of(seed: int, name: str, phase: int) -> int:
    """Return a run's seed, which depends only on the campaign's seed, the run's name and its phase."""
    text = f"{seed}/{name}/{phase}"
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4])
