"""The page of the command line has every command, and of each what its help shows."""

import re

import pytest

from docs import command_line

PAGE = command_line.PAGE.read_text(encoding="utf-8")
SECTIONS = dict(zip(*[iter(re.split(r"^####? stillwake (.+)\n", PAGE, flags=re.MULTILINE)[1:])] * 2, strict=True))


def test_the_page_is_up_to_date():
    assert command_line.page() == PAGE, "docs/reference/command-line.md: run `make generated`"


def test_every_command_has_a_section():
    groups = {name.split()[0] for name in command_line.commands() if " " in name}
    assert SECTIONS.keys() == command_line.commands().keys() | groups


@pytest.mark.parametrize("name", ["run", "bench latency", "can send"])
def test_a_section_has_the_options_of_the_help(cli, name):
    boxes = [line for line in cli(*name.split(), "--help").out.splitlines() if line.startswith("│ --")]
    shown = {line.split()[1] for line in boxes}
    assert len(shown) > 3
    assert set(re.findall(r"^\| `(--[\w-]+)", SECTIONS[name], re.MULTILINE)) == shown - {"--help"}


def test_a_row_has_what_an_option_takes_its_default_and_its_meaning():
    assert "| `--lead-in` | `NUMBER`, at least 0.2 | `25` | Time without control, t_c. |" in SECTIONS["run"]
    assert "| `OUTPUT` | `PATH` | required | Run folder to write. |" in SECTIONS["run"]
