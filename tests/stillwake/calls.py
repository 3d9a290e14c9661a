"""Calls of every verb with odd numbers, paths and words, made from the signatures of the commands."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin, get_type_hints

import typer
from hypothesis import strategies as st
from typer.models import ArgumentInfo, OptionInfo

from contract.config.listing import sections
from contract.config.tree import Config

NUMBERS: Final = (
    *("nan", "inf", "-inf", "1e400", "1e308", "-1e308", "1e-300", "0", "-0.0", "-1", "0.2", "1", "3", "1.5", "1e3"),
    *("9" * 30, "9" * 5000, "2147483648", "9223372036854775808", "1_000", " 1", "0x10", "", "one", "\u0663", "1\n"),
)
WORDS: Final = (
    *("", " ", "[/x]", "[red]x[/red]", ":smile:", "a\x1b[2Jb", "a\nb", "\udcff", "Zürich", "x" * 5000, "0", "-1"),
    *("none", "project", "%s", "{}", "a,b", ",", "../x", "tcp://", "cuda", "base_0", "train", "openfoam"),
)
# No device and no absolute path but of /proc, where nothing can be made: what writes files may replace what is there.
PATHS: Final = (
    *("missing", "missing/deeper/x", "folder", "empty-folder", "file", "file/x", "empty", "bundle", "release.key"),
    *(
        "release.pub",
        "settings.toml",
        "frames.log",
        "link-to-nowhere",
        "loop",
        "fifo-less",
        "[/x]",
        "[red]",
        ":smile:.npz",
    ),
    *("a\x1b[2Jb", "a\nb", "\udcff", "Zürich", "x" * 300, "x" * 5000, "x/" * 300 + "x", "", " ", ".", "./", "a\\b"),
    *("out.h5", "out.npz", "out.png", "out.gif", "out.mp4", "out.zip", "out.xyz", "/proc/nowhere/x", "-", "~", "file."),
)
SETTINGS: Final = tuple(one for section in sections(Config()) for one in section.settings)
USUAL: Final = {
    ("animate", "output"): "out.gif",
    ("picture", "output"): "out.png",
    ("develop", "duration"): "1",
    ("can", "output"): "out.log",
    ("can", "file"): "frames.log",
}
"""What a call needs to get past the first check, by verb and parameter."""


@dataclass(frozen=True)
class Parameter:
    """One argument or option: its name, its option on the command line ("" for an argument), and its plain type."""

    name: str
    option: str
    kind: Any
    is_required: bool


@dataclass(frozen=True)
class Verb:
    """A command by the words that call it."""

    words: tuple[str, ...]
    parameters: tuple[Parameter, ...]

    def __str__(self) -> str:
        return " ".join(self.words)


def verbs_of(app: typer.Typer, above: tuple[str, ...] = ()) -> Iterator[Verb]:
    """Every command of an app and of the groups in it."""
    for command in app.registered_commands:
        assert command.callback is not None
        yield Verb((*above, command.name or command.callback.__name__), tuple(_parameters(command.callback)))
    for group in app.registered_groups:
        assert group.typer_instance is not None
        assert isinstance(group.name, str)
        yield from verbs_of(group.typer_instance, (*above, group.name))


@st.composite
def calls(draw: st.DrawFn, verb: Verb) -> list[str]:
    """The words behind `stillwake`: usual ones, but for one to three that are odd."""
    odd = draw(st.sets(st.sampled_from([one.name for one in verb.parameters]), min_size=1, max_size=3))
    arguments: list[str] = []
    options: list[str] = []
    for one in verb.parameters:
        if one.name not in odd and not one.is_required:
            continue
        if one.kind is bool:
            options.append(one.option)
            continue
        value = draw(_odd(one)) if one.name in odd else USUAL.get((verb.words[0], one.name), "out")
        # Behind `=`, so that a leading dash is a value; "--" does it for arguments.
        (options if one.option else arguments).append(f"{one.option}={value}" if one.option else value)
    return [*verb.words, *options, *(["--", *arguments] if arguments else [])]


def _odd(one: Parameter) -> st.SearchStrategy[str]:
    if one.name == "overrides":
        names = st.sampled_from([setting.name for setting in SETTINGS])
        values = st.sampled_from([*NUMBERS, *WORDS])
        return st.builds(lambda name, value: f"{name}={value}", names, values) | st.sampled_from(WORDS)
    if one.kind is Path:
        return st.sampled_from(PATHS)
    if one.kind in (int, float):
        return st.sampled_from(NUMBERS)
    if get_origin(one.kind) is Literal:
        return st.sampled_from([*get_args(one.kind), *WORDS])
    return st.sampled_from([*WORDS, *PATHS])


def _parameters(command: Callable[..., Any]) -> Iterator[Parameter]:
    defaults = command.__kwdefaults__ or {}
    code, given = command.__code__, command.__defaults__ or ()
    with_default = {*code.co_varnames[code.co_argcount - len(given) : code.co_argcount], *defaults}
    for name, hint in get_type_hints(command, include_extras=True).items():
        if name == "return":
            continue
        plain, info = _plain(hint)
        decls = [decl for decl in (info.param_decls or ()) if decl.startswith("--")]
        option = "" if isinstance(info, ArgumentInfo) else (decls[0] if decls else f"--{name.replace('_', '-')}")
        yield Parameter(name, option, plain, name not in with_default)


def _plain(hint: Any) -> tuple[Any, ArgumentInfo | OptionInfo]:
    assert get_origin(hint) is Annotated, hint
    kind, *metadata = get_args(hint)
    (info,) = (item for item in metadata if isinstance(item, ArgumentInfo | OptionInfo))
    if get_origin(kind) in (Union, UnionType):
        (kind,) = (part for part in get_args(kind) if part is not type(None))
    return (get_args(kind)[0] if get_origin(kind) is list else kind), info
