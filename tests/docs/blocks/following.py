"""A page's command lines, one after the other, in one folder."""

import shlex
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from tests.conftest import Outcome
from tests.docs.blocks.given import MAKERS, Shared, give
from tests.docs.blocks.lines import Line
from tests.docs.blocks.plan import Cannot, Elsewhere, Rule, Run
from tests.docs.blocks.shell_elsewhere import CANNOT, ELSEWHERE
from tests.docs.blocks.shell_quick import QUICK
from tests.docs.blocks.shell_slow import SLOW

RULES: tuple[Rule, ...] = (*CANNOT, *ELSEWHERE, *QUICK, *SLOW)


def rule_of(line: Line) -> Rule | None:
    """The first one that is for the line."""
    return next((rule for rule in RULES if rule.is_for(line)), None)


def follow(
    lines: Sequence[Line], folder: Path, shared: Shared, cli: Callable[..., Outcome], *, everything: bool
) -> None:
    """Run what is to be run; raises AssertionError with the line and what it said."""
    for line in lines:
        rule = rule_of(line)
        if isinstance(rule, Cannot | Elsewhere):
            continue
        assert isinstance(rule, Run), f"{line.page}: no rule for: {line.text}"
        if everything or not rule.slow:
            give(line, folder, shared)
            call = rule.call(line)
            outcome = cli(*call)
            said = f"{line.page}: {line.text}\n(run as: {shlex.join(call)})\n{outcome.out[-1500:]}{outcome.err[-1500:]}"
            assert outcome.code in rule.statuses, f"status {outcome.code}: {said}"
            if line.goes_to is not None:
                (folder / line.goes_to).write_text(outcome.out, encoding="utf-8")
            if not rule.replaced:
                continue
        if rule.instead is not None:
            name, place = rule.instead
            _put(name, folder / line.words[place], shared)


def _put(name: str, path: Path, shared: Shared) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    MAKERS[name](path, shared)
