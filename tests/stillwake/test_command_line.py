"""The command line as a user meets it: its help, its version."""

import inspect
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from docs import command_line
from stillwake.console.old_words import rows

MOST_COMMANDS, MOST_OPTIONS, MOST_LINES = 32, 220, 80
"""Commands, options of all of them together, and lines of the function of one: more is not found, and not read."""
CHANGELOG = Path(__file__).parents[2] / "CHANGELOG.md"


def test_without_a_verb_it_lists_them_and_the_version_is_the_installed_one(cli):
    outcome = cli()
    assert outcome.code != 0
    assert all(verb.split()[0] in outcome.out + outcome.err for verb in command_line.commands())
    assert cli("--version").out == f"stillwake {version('stillwake')}\n"


def test_the_help_shows_text_in_brackets(cli):
    for words, command in command_line.commands().items():
        help_text, source = cli(*words.split(), "--help").out, inspect.getdoc(command.callback) or ""
        assert [text for text in re.findall(r"\[[^\]\s]+\]", source) if text not in help_text] == [], words


def test_it_stays_small():
    commands = command_line.commands()
    options = [one for command in commands.values() for one in command.params if one.param_type_name == "option"]
    assert len(commands) <= MOST_COMMANDS
    assert len(options) <= MOST_OPTIONS
    assert not [one for one in options if one.hidden]
    lines = {name: len(inspect.getsource(command.callback).splitlines()) for name, command in commands.items()}
    assert {name: count for name, count in lines.items() if count > MOST_LINES} == {}


def test_an_old_word_ends_with_a_line_that_names_the_new_one_and_the_changelog_has_them_all(cli):
    table = CHANGELOG.read_text(encoding="utf-8").partition("| was | is |\n|---|---|\n")[2].partition("\n\n")[0]
    told = set()
    for line in table.splitlines():
        command, words = (cell.strip(" `") for cell in line.strip("|").split(" | "))
        for old, new in re.findall(r"`?([^`;]+)`: `([^`;]+)", words) or [("", words)]:
            told.add((f"{'' if command == 'every command' else command} {old}".strip(), new))
    assert told == set(rows())
    for old, new in rows():
        # Where a command is gone, its name is told first.
        outcome = cli(*(old if not old.startswith("--") else f"run out {old}").split())
        assert (outcome.code, outcome.err) == (2, f"error: `{old}` is `{new}` now\n"), old


@pytest.mark.processes
def test_it_starts_without_what_a_vehicle_does_not_install():
    extras = ("h5py", "torch", "numba", "scipy", "matplotlib", "distributed")
    script = f"import sys; sys.modules.update(dict.fromkeys({extras!r})); import stillwake.__main__"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
