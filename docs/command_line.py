"""The lists of commands and options in `docs/reference/command-line.md`, from the commands' help."""

import re
from collections import Counter
from collections.abc import Collection, Iterator
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Final, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import typer

from stillwake.__main__ import PANELS, app

WORDS: Final = {Path: "PATH", str: "TEXT", float: "NUMBER", int: "INTEGER"}
"""The word that stands for an option's value, by the value's type. An option may define another word."""

_STATED: Final = re.compile(r"\bstatus\b|\bEnds with\b")
"""A pattern that finds the help's paragraphs about exit statuses. The page also contains these paragraphs."""
_CODE: Final = re.compile(r"(`[^`]*`)")
_PAGE: Final = re.compile(r"\bdocs/([\w-]+)/([\w-]+)\.md")
_WORD: Final = re.compile(r"(?<!\S)((?:--set )?[^\s(`]*=[^\s,;)]*[^\s,;).:]|--[a-z][\w-]*)")


@cache
def commands() -> dict[str, Any]:
    """Return every command by the words that follow `stillwake`. Groups of commands are left out."""
    return dict(_commands("", typer.main.get_command(app)))


def _commands(name: str, command: Any) -> Iterator[tuple[str, Any]]:
    inner = getattr(command, "commands", None)
    if inner is None:
        yield name.strip(), command
    else:
        for word, one in inner.items():
            yield from _commands(f"{name} {word}", one)


class _Option(NamedTuple):
    """An argument or an option as a line of the page shows it, without the default."""

    name: str
    bounds: str
    help: str

    def line(self, default: str = "") -> str:
        facts = ", ".join(filter(None, (default, self.bounds)))
        return f"- `{self.name}`{facts and f' ({facts})'}: {self.help}"


def common_options() -> str:
    """Return a line for each option that has the same text in several commands."""
    return "\n".join(sorted(one.line() for one in _common()))


def sections() -> str:
    """Return a section for every panel of the help, with a subsection for each command in the panel."""
    root: Any = typer.main.get_command(app)
    parts = []
    for panel in PANELS:
        parts.append(f"## {panel}")
        for name, command in root.commands.items():
            if command.rich_help_panel == panel:
                parts += _sections(name, command)
    return "\n\n".join(parts)


@cache
def _common() -> Collection[_Option]:
    counts = Counter(one for command in commands().values() for one, _ in _options(command) if one.name[0] == "-")
    return {one for one, count in counts.items() if count > 1}


def _sections(name: str, command: Any) -> Iterator[str]:
    group = getattr(command, "commands", None)
    if group is not None:
        yield f"### stillwake {name}\n\n{_marked(command.help)}"
    for words, one in _commands(name, command):
        yield f"{'###' if group is None else '####'} stillwake {words}\n\n{_marked(_explained(one))}"
        yield "\n".join(option.line(default) for option, default in _options(one) if option not in _common())
        shared = (
            f"`{option.name.split()[0]}`{default and f' ({default})'}"
            for option, default in _options(one)
            if option in _common()
        )
        if names := ", ".join(shared):
            yield f"Also {names}."


def _explained(command: Any) -> str:
    """Return the first paragraph of a command's help and the paragraphs on exit statuses. Only the links of the other
    paragraphs are returned."""
    first, *others = command.help.split("\n\n")
    stated = [text for text in others if _STATED.search(text)]
    pages = sorted({found[0] for text in others if text not in stated for found in _PAGE.finditer(text)})
    return "\n\n".join([f"{first} More: {', '.join(pages)}." if pages else first, *stated])


def _options(command: Any) -> Iterator[tuple[_Option, str]]:
    types = get_type_hints(command.callback)
    for one in command.params:
        takes = _takes(one, types[one.name])
        least = "" if one.min is None else f"{one.min:g}"
        bounds = f"{least}..{one.max:g}" if one.max is not None else least and f"≥{least}"
        # The page lacks the text that some options refer to.
        text = (one.help or "").replace("see above", "see `--help`")
        yield _Option(f"{_name(one)}{takes and ' '}{takes}", bounds, _marked(text)), _default(one)


def _name(parameter: Any) -> str:
    if parameter.param_type_name == "option":
        return "`, `".join([*parameter.opts, *parameter.secondary_opts])
    word = f"{parameter.metavar or parameter.name.upper()}{'...' * (parameter.nargs == -1)}"
    return word if parameter.required else f"[{word}]"


def _takes(parameter: Any, kind: Any) -> str:
    """Return the word for an option's value; "" for an argument or a flag."""
    if parameter.param_type_name == "argument" or getattr(parameter, "is_flag", False):
        return ""
    if get_origin(kind) in (Union, UnionType):
        (kind,) = (one for one in get_args(kind) if one is not NoneType)
    if get_origin(kind) in (list, tuple):
        kind = get_args(kind)[0]
    if get_origin(kind) is Literal:
        return "|".join(get_args(kind))
    return str(parameter.metavar or WORDS[kind])


def _default(parameter: Any) -> str:
    if parameter.required:
        return "required" if parameter.param_type_name == "option" else ""
    if parameter.default in (None, False, [], "") or parameter.default == ():
        return ""
    return f"{parameter.default:g}" if isinstance(parameter.default, float) else str(parameter.default)


def _marked(text: str) -> str:
    """Return a text in which options and NAME=VALUE are in code style, and the names of pages are links."""
    pieces = _CODE.split(text)
    for k, piece in enumerate(pieces):
        if not piece.startswith("`"):
            linked = _PAGE.sub(lambda found: f"[{found[2].replace('-', ' ')}](../{found[1]}/{found[2]}.md)", piece)
            pieces[k] = _WORD.sub(r"`\1`", linked)
    return "".join(pieces)


def parts() -> dict[str, str]:
    """Return the generated parts of the page by their names."""
    return {"common_options": common_options(), "commands": sections()}
