"""Blocks in Python and C: which tests run them, and what the others need around them."""

from typing import Final

RUN_HERE: Final = ("python", "c", "toml")

_EXAMPLES: Final = "tests/docs/test_examples.py::"
_EXTENDING: Final = "tests/docs/test_extending.py::"
PROGRAMS_ELSEWHERE: Final = {
    ("docs/explanation/protection.md", "python"): (f"{_EXAMPLES}test_a_node_in_real_time_counts_its_power_cycles",),
    ("docs/how-to/use-the-onnx-graph.md", "python"): (
        f"{_EXAMPLES}test_the_loop_around_the_onnx_graph_commands_within_the_limit",
    ),
    ("docs/how-to/use-your-own-data.md", "python"): (
        f"{_EXAMPLES}test_the_conversion_of_a_rig_s_numbers_gives_coefficients",
    ),
    ("docs/how-to/add-a-disturbance.md", "python"): (
        f"{_EXTENDING}test_every_third_frame_is_lost_at_a_port_and_in_a_run",
        f"{_EXTENDING}test_clipped_sensors_are_what_the_controller_reads",
    ),
    ("docs/how-to/add-a-plant.md", "python"): (
        f"{_EXTENDING}test_the_oscillator_sheds_at_its_own_frequency_without_jets",
        f"{_EXTENDING}test_the_shipped_controller_drives_it_over_the_bus",
    ),
    ("docs/how-to/add-a-sensor-selection.md", "python"): (
        f"{_EXTENDING}test_a_selection_finds_the_sensors_that_the_forces_are_made_of",
    ),
    ("docs/how-to/use-an-rtos.md", "c"): (
        "tests/export/to_c/ecu/examples/test_rtos_page.py::test_every_period_has_a_command_and_the_jets_are_driven",
    ),
}
"""The tests that run all programs of a page in a language."""

NOT_COMPILED: Final = {
    ("docs/how-to/use-the-onnx-graph.md", "cpp"): "needs ONNX Runtime's C++ headers, which no wheel has"
}

SHORTENED: Final = (
    ("Spans(lead_in=10, controlled=60, settle=20)", "Spans(lead_in=10, controlled=11, settle=0)"),
    ('"reset@6"', '"reset@1.5"'),
)
"""(what a page has, what runs instead)."""

AROUND_C: Final = {
    ("docs/how-to/integrate-the-ecu.md", '#include "sw_ecu.h"'): (
        """#include "sw_ecu.h"
#define ROOM 8
int page(int64_t now_ns, int n);
int page(int64_t now_ns, int n)
{
""",
        "return count;\n}",
    ),
    ("docs/how-to/use-the-c-library.md", "static sw_workspace workspace;"): (
        """#include "stillwake.h"
void wait_for_pressures(float *pressures);
void command_jets(float action);
void controller_task(void);
""",
        "",
    ),
}
"""What the prose says is there already, by page and first line: (before, after)."""
