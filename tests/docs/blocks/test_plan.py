"""Every block of every page is planned for, and the plan has nothing that no page has."""

import re

from tests.docs.blocks.following import RULES, rule_of
from tests.docs.blocks.fragments import FRAGMENTS, fragment
from tests.docs.blocks.lines import lines
from tests.docs.blocks.pages import ROOT, blocks
from tests.docs.blocks.plan import Elsewhere
from tests.docs.blocks.programs import NOT_COMPILED, PROGRAMS_ELSEWHERE, RUN_HERE

ALL = blocks()
LINES = [line for block in ALL if block.language == "shell" for line in lines(block)]


def test_the_pages_have_blocks():
    assert len(ALL) > 150
    assert len(LINES) > 300


def test_every_line_of_a_shell_is_planned_for():
    unknown = [f"{line.page}: {line.text}" for line in LINES if rule_of(line) is None]
    assert not unknown, "say in tests/docs/blocks/shell_*.py how these run:\n" + "\n".join(unknown)


def test_every_rule_is_for_a_line():
    used = [rule_of(line) for line in LINES]
    unused = [rule.form for rule in RULES if not any(rule is one for one in used)]
    assert not unused, "no page has such a line any more"


def test_every_other_block_is_known():
    for block in ALL:
        if not block.language:
            assert fragment(block), f"{block}: say in fragments.py what this is: {block.first}"
        elif block.language != "shell":
            place = (block.page, block.language)
            assert block.language in RUN_HERE or place in PROGRAMS_ELSEWHERE | NOT_COMPILED, f"{block}: what runs it?"


def test_the_plan_has_no_block_that_no_page_has():
    fragments = [block.first.strip() for block in ALL if not block.language]
    assert not [begin for begin in FRAGMENTS if not any(first.startswith(begin) for first in fragments)]
    places = {(block.page, block.language) for block in ALL}
    assert not (PROGRAMS_ELSEWHERE | NOT_COMPILED).keys() - places


def test_the_tests_that_the_plan_points_to_exist():
    named = [rule.test for rule in RULES if isinstance(rule, Elsewhere)] + [
        test for tests in PROGRAMS_ELSEWHERE.values() for test in tests
    ]
    for name in named:
        path, _, function = name.partition("::")
        source = (ROOT / path).read_text(encoding="utf-8")
        assert re.search(rf"^def {function}\(", source, re.MULTILINE), f"no test {name}"
