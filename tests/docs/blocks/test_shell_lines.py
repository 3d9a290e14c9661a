"""The command lines of each page run in their order, as far as the plan says."""

import os
from pathlib import Path

import pytest

pytest.importorskip("cantools")

from tests.docs.blocks.following import follow, rule_of
from tests.docs.blocks.fragments import files_of
from tests.docs.blocks.given import begin
from tests.docs.blocks.lines import Line, lines
from tests.docs.blocks.pages import Block, blocks
from tests.docs.blocks.plan import Run

ALL = blocks()
PAGES = list(dict.fromkeys(block.page for block in ALL))


def of_page(page: str) -> tuple[list[Block], list[Line]]:
    its = [block for block in ALL if block.page == page]
    return its, [line for block in its if block.language == "shell" for line in lines(block)]


def pages_with(*, slow: bool) -> list[str]:
    """Pages with a line that runs, and does so at all times or in `make full` alone."""
    rules = {page: [rule_of(line) for line in of_page(page)[1]] for page in PAGES}
    return [page for page in PAGES if any(isinstance(rule, Run) and rule.slow == slow for rule in rules[page])]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow  # some hundred commands
@pytest.mark.parametrize("page", pages_with(slow=False))
def test_what_is_quick(page, folder, shared, cli):
    its, written = of_page(page)
    begin(folder, files_of(its))
    follow(written, folder, shared, cli, everything=False)
    assert os.listdir(folder)


@pytest.mark.pages
@pytest.mark.parametrize("page", pages_with(slow=True))
def test_all_of_it(page, folder, shared, cli):
    its, written = of_page(page)
    begin(folder, files_of(its))
    follow(written, folder, shared, cli, everything=True)
