"""One run of a campaign, in whatever process: the loop under its disturbances, or the flow without control."""

from collections import Counter
from collections.abc import Iterable
from typing import Final

import numpy as np

from can_bridge.wire.messages import Mode, Reason
from contract.errors import ConfigError, StillwakeError
from contract.config.tree import Config
from contract.release.bundle import Bundle
from firmware_sim.bench.disturbances import Disturbances
from firmware_sim.bench.simulation import simulate
from firmware_sim.campaign.outcome import MOST_KEPT, Course, Figures, Outcome, Service
from firmware_sim.campaign.scenario import Scenario
from firmware_sim.campaign.task import Task, Timing
from firmware_sim.runs.run_log import RunLog
from wake.truck.state import State
from wake.truck.truck_wake import TruckWake
