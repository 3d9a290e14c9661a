"""The last check before a jet command goes on the bus. It trusts nothing that comes from the controller.

In this order: no permission, no finite number, a clock that stood still or no fresh pressure shuts the jets at once;
otherwise the command is brought into range and then to within one step of the command before it. Zero is the safe
state, so shutting is never slowed down.

Pressures that are too old for a new command may still bear one that leads from the command before it towards zero:
that is what a fail-safe holds and halves.
"""

import math
from dataclasses import dataclass, replace
from enum import Flag, auto
from typing import Self

from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S, INT16_MAX
from contract.config.tree import Config
from contract.errors import ConfigError


class Intervention(Flag):
    """What the gate had to do; empty if the command passed as it was."""

    NOT_ENABLED = auto()
    NOT_FINITE = auto()
    CLOCK = auto()
    STALE = auto()
    RANGE = auto()
    RATE = auto()


@dataclass(frozen=True, kw_only=True)
class GateLimits:
    """Bounds on what may pass.

    Attributes:
        flow_m2_per_s: largest magnitude of the command.
        step_m2_per_s: largest change from one command to the next, a period or more later; in a shorter time the
            change is smaller in proportion.
        fresh_age_ns: oldest pressures that any command may rest on.
        held_age_ns: oldest pressures that a command may rest on which lies between the one before it and zero.
    """

    flow_m2_per_s: float
    step_m2_per_s: float
    period_ns: int
    fresh_age_ns: int
    held_age_ns: int

    @classmethod
    def from_config(cls, config: Config) -> Self:
        """The limits of a vehicle.

        The range ends on a step of the wire, so that rounding on emission cannot lead out of it. The ages let the
        fail-safe's hold and decay through and nothing after them. Raises ConfigError if the wire cannot carry the
        action limit at this operating point.
        """
        scale = config.operating_point.flow_rate_scale
        limit = config.flow.action_limit * scale
        # The small number keeps a limit that is itself a step of the wire.
        steps = math.floor(limit / FLOW_RESOLUTION_M2_PER_S + 1e-6)
        if steps > INT16_MAX:
            widest = INT16_MAX * FLOW_RESOLUTION_M2_PER_S
            raise ConfigError(
                f"flow.action_limit is {limit:g} m2/s at this speed and width: JetCommand ends at {widest:g}"
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
        """The limits with the narrower of both ranges and the smaller of both steps; the times stay."""
        return replace(
            self,
            flow_m2_per_s=min(self.flow_m2_per_s, other.flow_m2_per_s),
            step_m2_per_s=min(self.step_m2_per_s, other.step_m2_per_s),
        )


@dataclass(frozen=True, kw_only=True)
class GatedCommand:
    """What goes on the bus. `flow_m2_per_s` is also the next call's `previous_m2_per_s`."""

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
    """Let a command pass, bring it within bounds, or shut the jets. Call it once for each command sent.

    Args:
        flow_m2_per_s: what the controller or its fail-safe asks for.
        enable: whether the jets may run.
        previous_m2_per_s: what this gate let pass last; 0 at the start.
        previous_ns: when it did; None at the start.
        pressure_ns: when the pressures behind the command were sampled; None if there were none.
        now_ns: same clock. A pressure from the future counts as stale: one of the two clocks is wrong.
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
        # The range has the last word, whatever `previous` was.
        passed = _clamp(passed, -limits.flow_m2_per_s, limits.flow_m2_per_s)
    return GatedCommand(flow_m2_per_s=passed, enable=True, interventions=interventions)


def _shut(why: Intervention) -> GatedCommand:
    return GatedCommand(flow_m2_per_s=0.0, enable=False, interventions=why)


def _clamp(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)
