"""What a test may cost: CPU seconds of its call by its markers, its children included; shown with `--budget=shown`.

CPU seconds and not wall time, because other processes lengthen the latter. Fixtures of a session are not counted: who
comes first pays for them. `make check` and `make test` give it; a single file is run without. A test that is
over fails nobody's run, since machines differ, unless `--budget=held` asks for that (`make test HOLD=1`).
"""

import os
from collections.abc import Iterator
from typing import Any, Final

import pytest

SECONDS: Final = {
    **{"openfoam": 600.0, "proofs": 3600.0, "pages": 600.0},
    **dict.fromkeys(("slow", "compiler", "mcu", "processes", "browser"), 10.0),
}
"""By marker; the largest counts."""
UNMARKED: Final = 0.5
ALLOWANCE: Final = 2.0
"""A test is over beyond this multiple of its budget: machines differ, and neighbours on a core cost time too."""
IMPORTS_S: Final = 2.0
"""And so much later: the first test of a process that calls a command pays for the packages which that imports."""
_Cost = tuple[float, float, str]  # cPU seconds, the budget, the test


def _limit_s(budget: float) -> float:
    return ALLOWANCE * budget + IMPORTS_S


def _cpu_s() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


class Budget:
    """Measures every test of a process, and reports what all processes measured."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._costs: list[_Cost] = []
        self._held = config.getoption("--budget") == "held"

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        before = _cpu_s()
        try:
            return (yield)
        finally:
            markers = {marker.name for marker in item.iter_markers()}
            budget = max((SECONDS[name] for name in markers & SECONDS.keys()), default=UNMARKED)
            self._costs.append((_cpu_s() - before, budget, item.nodeid))

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        self._costs += [tuple(cost) for cost in getattr(node, "workeroutput", {}).get("costs", ())]

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Hand over what this process measured, or fail where the budget is held."""
        if hasattr(self._config, "workeroutput"):
            self._config.workeroutput.update(costs=self._costs)
        elif self._over() and self._held and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        if hasattr(self._config, "workeroutput"):
            return
        write = terminalreporter.write_line
        total = sum(cost for cost, _, _ in self._costs)
        terminalreporter.section("CPU seconds of calls")
        write(f"{total:.0f} s in {len(self._costs)} tests; the slowest:")
        for cost, _, name in sorted(self._costs, reverse=True)[:10]:
            write(f"{cost:6.2f} s  {name}")
        for cost, budget, name in self._over():
            write(
                f"OVER BUDGET {name}: {cost:.2f} s, {_limit_s(budget):g} s are planned; make it cheaper, or give it "
                f"the marker that says why it is slow",
                **{"red" if self._held else "yellow": True},
            )

    def _over(self) -> list[_Cost]:
        return [cost for cost in self._costs if cost[0] > _limit_s(cost[1])]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--budget", choices=("shown", "held"), help="show costs; held: fail for tests over their budget")


def pytest_configure(config: pytest.Config) -> None:
    """Measure where the option asks for it; workers are asked by the process that starts them."""
    if config.getoption("--budget"):
        config.pluginmanager.register(Budget(config), "budget")
