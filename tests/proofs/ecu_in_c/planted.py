"""Faults that are planted in the C sources, one at a time: the comparison has to notice every one."""

from typing import Final, NamedTuple


class Planted(NamedTuple):
    """A fault.

    Attributes:
        what: is wrong.
        variant: of the vehicle in which it can be seen.
        file: of the source.
        old, new: text in it; the old one stands there once.
    """

    what: str
    variant: str
    file: str
    old: str
    new: str

    def into(self, sources: dict[str, bytes]) -> dict[str, bytes]:
        """The sources with it; raises ValueError if they no longer have the place."""
        before = sources[self.file].decode()
        if before.count(self.old) != 1:
            raise ValueError(f"{self.file}: {self.old!r} stands there {before.count(self.old)} times: must be once")
        return sources | {self.file: before.replace(self.old, self.new).encode()}


PLANTED: Final = (
    Planted(
        "a narrower limit is not brought to a step of the wire", "as shipped", "sw_calibration.c",
        "(double)(int32_t)steps * SW_FLOW_RESOLUTION", "steps * SW_FLOW_RESOLUTION",
    ),
    Planted(
        "a plan stays where it is when the delay changes", "not planning ahead", "sw_memory.c",
        "plan[clipped(k - later, SW_HORIZON - 1)]", "plan[k]",
    ),
    Planted(
        "another ECU is gone a nanosecond too early", "classic", "sw_reception.c",
        "step_ns > other->until_ns", "step_ns >= other->until_ns",
    ),
    Planted(
        "pressures of the oldest age are refused", "as shipped", "sw_gate.c",
        "elapsed_ns(pressure_ns, now_ns) <= (uint64_t)oldest_ns",
        "elapsed_ns(pressure_ns, now_ns) < (uint64_t)oldest_ns",
    ),
    Planted(
        "a counter begins again one too early", "as shipped", "sw_ecu.c",
        "(state->command_counter + 1u) % SW_E2E_COUNTERS", "(state->command_counter + 1u) % (SW_E2E_COUNTERS - 1u)",
    ),
    Planted(
        "the loss window forgets its oldest period", "late actuator, long windows", "sw_fail_safe.c",
        "UINT64_MAX >> (64 - SW_LOSS_WINDOW)", "UINT64_MAX >> (65 - SW_LOSS_WINDOW)",
    ),
    Planted(
        "a quotient is rounded towards zero", "as shipped", "sw_timing.c",
        "return value % by < 0 ? towards_zero - 1 : towards_zero;", "return towards_zero;",
    ),
    Planted(
        "an action is kept as a float", "not planning ahead", "sw_ecu.c",
        "sw_memory_commanded(&state->memory, action);", "sw_memory_commanded(&state->memory, (double)(float)action);",
    ),
    Planted(
        "a plan that is not finite is taken", "as shipped", "sw_ecu.c",
        "if (status == SW_OK && finite)", "if (status == SW_OK || finite)",
    ),
    Planted(
        "a 29-bit identifier is taken for the pressures'", "classic", "sw_receiver.c",
        "frame->id == message->id && !frame->is_extended", "frame->id == message->id",
    ),
    Planted(
        "a check of the receiver's window is counted as an error", "late actuator, long windows", "sw_receiver.c",
        "if (count_of(receiver, SW_CHECK_ERROR) > SW_E2E_MAX_ERRORS)",
        "if (count_of(receiver, SW_CHECK_ERROR) >= SW_E2E_MAX_ERRORS)",
    ),
    Planted(
        "a period that helps is one of doubt", "quick to doubt", "sw_benefit.c",
        "benefit->doubt--;", "benefit->doubt++;",
    ),
    Planted(
        "the others' mean is that of one more", "quick to doubt", "sw_sensors.c",
        "(sum - values[own]) / (double)(SW_SENSORS - 1)", "(sum - values[own]) / (double)SW_SENSORS",
    ),
    Planted(
        "a fault does not ask for a request that falls", "as shipped", "sw_fail_safe.c",
        "now.request = !inputs->has_request || inputs->enable_request;", "",
    ),
    Planted(
        "a command above the design speed follows by a share as well", "classic, at all speeds", "sw_past.c",
        "share >= 1.0 ? to : before", "share > 1.2 ? to : before",
    ),
    Planted(
        "a row between two others has the other one's share", "at all speeds", "sw_past.c",
        "newer + share * (past->rows[older][c] - newer)", "newer + (1.0 - share) * (past->rows[older][c] - newer)",
    ),
    Planted(
        "a row that lies at a period's end is left for the one before", "classic, at all speeds", "sw_past.c",
        "age + past->speeds[at] <= steps", "age + past->speeds[at] < steps",
    ),
    Planted(
        "the margin narrows the range", "at all speeds", "sw_speed.c",
        "release->slowest - margin", "release->slowest + margin",
    ),
    Planted(
        "a speed at the end of the range is outside", "classic, at all speeds", "sw_speed.c",
        "speed->ratio <= release->fastest + margin", "speed->ratio < release->fastest + margin",
    ),
    Planted(
        "a speed is kept a nanosecond too short", "at all speeds", "sw_speed.c",
        "age_of(speed, now_ns) > (uint64_t)SW_OLDEST_SPEED_NS", "age_of(speed, now_ns) >= (uint64_t)SW_OLDEST_SPEED_NS",
    ),
    Planted(
        "a stated density is left out", "at all speeds", "sw_speed.c",
        "stated.density_kg_per_m3 > 0.0 ? stated.density_kg_per_m3 : release->design_density",
        "release->design_density",
    ),
    Planted(
        "no acceleration is judged over less than a period", "classic, at all speeds", "sw_speed.c",
        "elapsed_s > SW_SHORTEST_S ? elapsed_s : SW_SHORTEST_S", "elapsed_s",
    ),
    Planted(
        "outside its speeds the past stays", "at all speeds", "sw_ecu.c",
        "if (state->speed.is_off) {\n        sw_memory_emptied(memory);", "if (state->speed.is_off) {",
    ),
    Planted(
        "a past stays where it is when the delay changes", "classic, at all speeds", "sw_memory.c",
        "if (later != 0) sw_memory_emptied(memory);", "if (later > 1) sw_memory_emptied(memory);",
    ),
    Planted(
        "a sensor that rests is sought in what follows the speed", "at all speeds", "sw_ecu.c",
        "const double *reading = received.reading;", "const double *reading = received.cp;",
    ),
    Planted(
        "what is under way is taken to be in units of the present speed", "classic, at all speeds", "sw_memory.c",
        "const double sent = memory->under_way[k] / speed;", "const double sent = memory->under_way[k];",
    ),
)  # fmt: skip
