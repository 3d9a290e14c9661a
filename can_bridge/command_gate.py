"""The last check before a jet command is sent on the bus. It assumes nothing about the controller's output.

The gate shuts the jets if control is not permitted, the command is not finite, the clock did not advance, or the
pressures are too old. Otherwise the gate limits the command to its range, and then its change since the previous
command to one step; the result stays in the range. Zero is the safe state, so shutting the jets needs no limit.

A command between the previous command and zero may be based on older pressures than any other command, because without
new pressures the fail-safe first repeats and then halves the last command.
"""

import math
from dataclasses import dataclass, replace
from enum import Flag, auto
from typing import Self

from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S, INT16_MAX
from contract.config.tree import Config
from contract.errors import ConfigError


class Intervention(Flag):
    """The changes that the gate made to a command; empty if the command passed unchanged."""

    NOT_ENABLED = auto()
    NOT_FINITE = auto()
    CLOCK = auto()
    STALE = auto()
    RANGE = auto()
    RATE = auto()


@dataclass(frozen=True, kw_only=True)
class GateLimits:
    """The bounds on the commands that may pass.

    Attributes:
        flow_m2_per_s: largest magnitude of the command.
        step_m2_per_s: largest change between two commands that are a period or more apart. In a shorter time the
            largest change is smaller in proportion.
        fresh_age_ns: largest age of the pressures on which any command may be based.
        held_age_ns: largest age of the pressures on which a command between the previous command and zero may be based.
    """

    flow_m2_per_s: float
    step_m2_per_s: float
    period_ns: int
    fresh_age_ns: int
    held_age_ns: int

    @classmethod
    def from_config(cls, config: Config) -> Self:
        """Return the limits of a vehicle.

        `flow_m2_per_s` is a multiple of the message's resolution, so that no rounded command is larger. `held_age_ns`
        is the pressures' greatest age while the fail-safe holds the last command and lets it decay; `fresh_age_ns` is
        never larger. Raises ConfigError if the action limit at this operating point exceeds the message's range.
        """
        scale = config.operating_point.flow_rate_scale
        limit = config.flow.action_limit * scale
        # The addition prevents a rounding error from reducing a limit that is itself a multiple of the resolution.
        steps = math.floor(limit / FLOW_RESOLUTION_M2_PER_S + 1e-6)
        if steps > INT16_MAX:
            widest = INT16_MAX * FLOW_RESOLUTION_M2_PER_S
            raise ConfigError(
                f"flow.action_limit is {limit:g} m2/s at this speed and width: JetCommand's range ends at {widest:g}; "
                f"state the vehicle's operating_point.width and operating_point.speed"
            )
        held_age_ns = (1 + config.ecu.hold_periods + config.ecu.decay_periods) * config.period_ns
        return cls(
            flow_m2_per_s=steps * FLOW_RESOLUTION_M2_PER_S,
            step_m2_per_s=config.ecu.command_step * scale,
            period_ns=config.period_ns,
            fresh_age_ns=min(round(config.ecu.pressure_age * config.period_ns), held_age_ns),
            held_age_ns=held_age_ns,
        )

    def narrowed(self, other: Self) -> Self:
        """Return these limits with a flow limit and a step limit that do not exceed the limits in `other`."""
        return replace(
            self,
            flow_m2_per_s=min(self.flow_m2_per_s, other.flow_m2_per_s),
            step_m2_per_s=min(self.step_m2_per_s, other.step_m2_per_s),
        )


@dataclass(frozen=True, kw_only=True)
class GatedCommand:
    """The gate's result. Pass its `flow_m2_per_s` to the next call of `gate` as `previous_m2_per_s`."""

    flow_m2_per_s: float
    enable: bool
    interventions: Intervention


def gate(
    flow_m2_per_s: float,
    *,
    enable: bool,
    previous_m2_per_s: float,
    previous_ns: int | None,
    pressure_ns: int | None,
    now_ns: int,
    limits: GateLimits,
) -> GatedCommand:
    """Let a command pass, limit it, or shut the jets. Call this function once for each command that is sent.

    Args:
        flow_m2_per_s: command of the controller or its fail-safe.
        previous_m2_per_s: this gate's previous result; 0 at the start.
        previous_ns: time of the previous result; None at the start.
        pressure_ns: sampling time of the pressures that the command uses; None without pressures.
        now_ns: present time, on the same clock as all times here. Pressures with a later sampling time count as stale,
            because one of the clocks is then wrong.
    """
    if not enable:
        return _shut(Intervention.NOT_ENABLED)
    if not math.isfinite(flow_m2_per_s):
        return _shut(Intervention.NOT_FINITE)
    if previous_ns is not None and now_ns <= previous_ns:
        return _shut(Intervention.CLOCK)
    towards_zero = min(0.0, previous_m2_per_s) <= flow_m2_per_s <= max(0.0, previous_m2_per_s)
    oldest_ns = limits.held_age_ns if towards_zero else limits.fresh_age_ns
    if pressure_ns is None or not 0 <= now_ns - pressure_ns <= oldest_ns:
        return _shut(Intervention.STALE)

    in_range = _clamp(flow_m2_per_s, -limits.flow_m2_per_s, limits.flow_m2_per_s)
    interventions = Intervention(0) if in_range == flow_m2_per_s else Intervention.RANGE
    step = limits.step_m2_per_s
    if previous_ns is not None:
        step *= min(1.0, (now_ns - previous_ns) / limits.period_ns)
    passed = _clamp(in_range, previous_m2_per_s - step, previous_m2_per_s + step)
    if passed != in_range:
        interventions |= Intervention.RATE
        # The range is applied last, so that the command is within the range for any value of `previous_m2_per_s`.
        passed = _clamp(passed, -limits.flow_m2_per_s, limits.flow_m2_per_s)
    return GatedCommand(flow_m2_per_s=passed, enable=True, interventions=interventions)


def _shut(why: Intervention) -> GatedCommand:
    return GatedCommand(flow_m2_per_s=0.0, enable=False, interventions=why)


def _clamp(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)
