"""The tool for the firmware's bounds finds a loop without one, a recursion, and a call to no known function."""

import shutil
from typing import Any, Final

import pytest

from benchmarks.controller.bounds import bounds, deepest
from benchmarks.controller.whole_program import COMPILER, read_program
from contract.errors import McuError
from ecu.c.sources import sources_in

pytestmark = [
    pytest.mark.compiler,
    pytest.mark.skipif(shutil.which(COMPILER) is None, reason=f"{COMPILER} is not installed"),
]
UNKNOWN: Final[dict[str, Any]] = {"most": {}, "waits": {}}
MAIN: Final = """
#include <stdint.h>
typedef int (*operation)(uint8_t value);
volatile int input;
static const int table[7] = {1, 2, 3, 4, 5, 6, 7};
static int twice(uint8_t value) { return 2 * value; }
static int added(int count)
{
    int sum = 0;
    for (int i = 0; i < count; i++) sum += table[i % 7];
    return sum;
}
static int again(int value) { return value; }
static operation chosen = twice;
void sw_board_unexpected(void) {}
void sw_board_tick(void) {}
__attribute__((section(".vectors"), used)) static void (*const vectors[])(void) = {sw_board_unexpected, sw_board_tick};
void sw_board_start(void) { input = added(5) + chosen((uint8_t)input) + again(input); }
"""


def firmware(*changes: tuple[str, str]) -> dict[str, bytes]:
    text = MAIN
    for old, new in changes:
        assert text.count(old) == 1
        text = text.replace(old, new)
    # The table's reasons are kept by the names of these files.
    parts = {"sw_board.ld": sources_in("board")["sw_board.ld"], "sw_board_core.c": b""}
    return {**parts, "sw_board_start.c": text.encode()}


def test_what_has_a_bound_is_listed_with_it():
    program = read_program(firmware())
    found = bounds(program, UNKNOWN)
    assert found["loops"] == ["added (sw_board_start.c) 10: 5"]
    assert (found["proved"], found["reasoned"], found["waits"]) == (1, 0, 0)
    assert "twice (sw_board_start.c)" in program.pointed_at
    assert {"twice (sw_board_start.c)"} < program.written.calls["sw_board_start (sw_board_start.c)"]
    # Without a figure for a function of the runtime, its stack counts as the deepest of the runtime's.
    depth, chain = deepest(program.built.calls, "sw_board_start (sw_board_start.c)", 1000)
    assert (depth < 100, chain[-1]) == (True, "twice (sw_board_start.c)")


FAULTS: Final = (
    ("added(5)", "added(input)"),
    ("{ return value; }", "{ return value > 0 ? value + again(value - 2) * again(value - 1) : 0; }"),
    ("= twice;", "= (operation)0;"),
)


def test_planted_faults_are_reported_and_a_reason_gives_a_bound():
    program = read_program(firmware(*FAULTS))
    with pytest.raises(McuError) as raised:
        bounds(program, UNKNOWN)
    for message in (
        "added (sw_board_start.c): the loop at sw_board_start.c:10 has no bound",
        "again (sw_board_start.c) calls again (sw_board_start.c): recursion",
        "a call through a pointer reaches no known function",
    ):
        assert message in str(raised.value)
    known: dict[str, dict[str, Any]] = {
        "most": {"added (sw_board_start.c)": [9, "nine"]}, "waits": {"twice (sw_board_start.c)": "none"}
    }  # fmt: skip
    with pytest.raises(McuError, match="twice") as raised:
        bounds(program, known)
    assert "added (sw_board_start.c): the loop" not in str(raised.value)
    known["waits"].clear()
    assert bounds(read_program(firmware(FAULTS[0])), known)["loops"] == ["added (sw_board_start.c) 10: 9: nine"]
