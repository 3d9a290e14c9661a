"""The command gate by itself: calls that no ECU makes of it, with what the Python gate lets pass."""

import math
import struct
from random import Random
from typing import Any, Final, NamedTuple

from can_bridge.command_gate import GateLimits, gate
from contract.config.tree import Config

DECLARATION: Final = """
typedef struct { double flow_m2_per_s; uint8_t enable; uint8_t interventions; } sw_gated;
sw_gated sw_gate(double flow_m2_per_s, int enable, double previous_m2_per_s, int has_previous, int64_t previous_ns,
                 int has_pressures, int64_t pressure_ns, int64_t now_ns, const sw_gate_limits *limits);
"""
_WILD: Final = (math.nan, math.inf, -math.inf, 1.7976931348623157e308, -1.7976931348623157e308, 0.0, -0.0)


class Case(NamedTuple):
    """Arguments of `sw_gate` in their order, its limits, and its answer: the flow's bits, enable, interventions."""

    arguments: tuple[float, int, float, int, int, int, int, int]
    limits: tuple[float, float]
    answer: tuple[bytes, int, int]


def cases(config: Config, count: int, seed: int = 0) -> list[Case]:
    rng, limits = Random(seed), GateLimits.from_config(config)
    return [_case(_arguments(rng, limits), limits) for _ in range(count)]


def is_passed(ffi: Any, library: Any, wanted: list[Case]) -> bool:
    return all(
        _answer(library.sw_gate(*case.arguments, ffi.new("sw_gate_limits *", case.limits))) == case.answer
        for case in wanted
    )


def _answer(gated: Any) -> tuple[bytes, int, int]:
    return struct.pack("<d", gated.flow_m2_per_s), gated.enable, gated.interventions


def _arguments(rng: Random, limits: GateLimits) -> tuple[float, int, float, int, int, int, int, int]:
    limit, step, period = limits.flow_m2_per_s, limits.step_m2_per_s, limits.period_ns
    edges = (limit, -limit, step, -step, 0.0, 2 * limit, -2 * limit, 0.5 * limit)
    previous = rng.choice((*edges, limit + 3.0 * step, -limit - 3.0 * step, rng.uniform(-limit, limit)))
    wanted = (previous, previous + step, previous - step, math.nextafter(previous, math.inf), 0.5 * previous)
    flow = rng.choice((*edges, *wanted, *_WILD, rng.uniform(-limit, limit)))
    now_ns = rng.choice((10**12, 0, 1, 2**61, rng.randrange(10**13)))
    elapsed = rng.choice((period, period - 1, period + 1, period // 2, 1, 0, -1, rng.randrange(period)))
    age = rng.choice((0, limits.fresh_age_ns, limits.held_age_ns)) + rng.choice((-1, 0, 0, 1))
    times = rng.choice((0, now_ns - elapsed, now_ns - elapsed)), rng.choice((0, now_ns - age, now_ns - age, now_ns + 1))
    enable, has_previous, has_pressures = (int(rng.random() < share) for share in (0.95, 0.8, 0.9))
    return flow, enable, previous, has_previous, times[0], has_pressures, times[1], now_ns


def _case(arguments: tuple[float, int, float, int, int, int, int, int], limits: GateLimits) -> Case:
    flow, enable, previous, has_previous, previous_ns, has_pressures, pressure_ns, now_ns = arguments
    passed = gate(
        flow,
        enable=bool(enable),
        previous_m2_per_s=previous,
        previous_ns=previous_ns if has_previous else None,
        pressure_ns=pressure_ns if has_pressures else None,
        now_ns=now_ns,
        limits=limits,
    )
    answer = struct.pack("<d", passed.flow_m2_per_s), int(passed.enable), passed.interventions.value
    return Case(arguments, (limits.flow_m2_per_s, limits.step_m2_per_s), answer)
