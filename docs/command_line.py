"""Write `docs/reference/command-line.md` from the commands and their help: `make generated`."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Final, Literal, Union, get_args, get_origin, get_type_hints

import typer

from stillwake.__main__ import EPILOG, PANELS, app

ROOT: Final = Path(__file__).resolve().parents[1]
PAGE: Final = ROOT / "docs" / "reference" / "command-line.md"

WORDS: Final = {Path: "PATH", str: "TEXT", float: "NUMBER", int: "INTEGER"}
"""What an option takes that has no word of its own."""

_CODE: Final = re.compile(r"(`[^`]*`)")
_CALL: Final = re.compile(r"stillwake .*[^.]$")
_PAGE: Final = re.compile(r"\bdocs/([\w-]+)/([\w-]+)\.md")
_WORD: Final = re.compile(r"(?<!\S)((?:--set )?[^\s(`]*=[^\s,;)]*[^\s,;).:]|--[a-z][\w-]*)")

_HEAD: Final = f"""# Command line

For everyone who types a command: every verb of `stillwake` with its arguments, its options and their defaults. At the
end of this page you can write the call that you need. In a terminal `--help` after any of them prints the same.
`make generated` writes this page from `stillwake/commands/`.

{EPILOG}

Exit status 0 is success, 1 an error that one line on standard error names, and 2 a call that the command line does not
understand. Others stand with the command that has them. `--set` takes the names in
[settings](settings.md)."""


def page() -> str:
    """The whole page: a section for every panel of the help, in it one for every command."""
    root: Any = typer.main.get_command(app)
    parts = [_HEAD]
    for panel in PANELS:
        parts.append(f"\n## {panel}")
        for name, command in root.commands.items():
            if command.rich_help_panel == panel:
                parts += _sections(name, command)
    return "\n".join(parts) + "\n"


def commands() -> dict[str, Any]:
    """Every command by its words after `stillwake`; a group is not one."""
    return dict(_commands("", typer.main.get_command(app)))


def _commands(name: str, command: Any) -> Iterator[tuple[str, Any]]:
    inner = getattr(command, "commands", None)
    if inner is None:
        yield name.strip(), command
    else:
        for word, one in inner.items():
            yield from _commands(f"{name} {word}", one)


def _sections(name: str, command: Any) -> Iterator[str]:
    group = getattr(command, "commands", None)
    if group is not None:
        yield f"\n### stillwake {name}\n\n{_marked(command.help)}"
    for words, one in _commands(name, command):
        yield f"\n{'###' if group is None else '####'} stillwake {words}\n\n{_marked(one.help)}\n"
        yield f"Usage: `{_usage(words, one)}`\n"
        yield "| argument or option | takes | default | meaning |\n|---|---|---|---|"
        types = get_type_hints(one.callback)
        yield from (_row(parameter, types[parameter.name]) for parameter in one.params)


def _usage(words: str, command: Any) -> str:
    arguments = [one for one in command.params if one.param_type_name == "argument"]
    marks = [f"{_word(one)}..." if one.nargs == -1 else _word(one) for one in arguments]
    shown = [mark if one.required else f"[{mark}]" for mark, one in zip(marks, arguments, strict=True)]
    return " ".join([f"stillwake {words} [OPTIONS]", *shown])


def _word(argument: Any) -> str:
    return str(argument.metavar or argument.name.upper())


def _row(parameter: Any, kind: Any) -> str:
    is_argument = parameter.param_type_name == "argument"
    name = _word(parameter) if is_argument else ", ".join([*parameter.opts, *parameter.secondary_opts])
    takes = "" if getattr(parameter, "is_flag", False) else _takes(parameter, kind)
    cells = (f"`{name}`", takes, _default(parameter), _marked(parameter.help or ""))
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def _takes(parameter: Any, kind: Any) -> str:
    if get_origin(kind) in (Union, UnionType):
        (kind,) = (one for one in get_args(kind) if one is not NoneType)
    if get_origin(kind) in (list, tuple):
        kind = get_args(kind)[0]
    if get_origin(kind) is Literal:
        return " or ".join(f"`{one}`" for one in get_args(kind))
    ends = (("at least", parameter.min), ("at most", parameter.max))
    bounds = [f"{sign} {bound:g}" for sign, bound in ends if bound is not None]
    return ", ".join(
        [f"`{parameter.metavar or WORDS[kind]}`", *bounds, *(["repeatable"] if parameter.multiple else [])]
    )


def _default(parameter: Any) -> str:
    if parameter.required:
        return "required"
    if parameter.default in (None, False, []) or parameter.default == ():
        return ""
    return f"`{parameter.default:g}`" if isinstance(parameter.default, float) else f"`{parameter.default}`"


def _marked(text: str) -> str:
    """Calls, options and NAME=VALUE as code, pages of these documents as links."""
    return "\n\n".join(
        f"`{paragraph}`" if _CALL.match(paragraph) else "".join(map(_marked_piece, _CODE.split(paragraph)))
        for paragraph in text.split("\n\n")
    )


def _marked_piece(piece: str) -> str:
    if piece.startswith("`"):
        return piece
    linked = _PAGE.sub(lambda found: f"[{found[2].replace('-', ' ')}](../{found[1]}/{found[2]}.md)", piece)
    return _WORD.sub(r"`\1`", linked)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    sys.stdout.write(f"wrote {PAGE}\n")
