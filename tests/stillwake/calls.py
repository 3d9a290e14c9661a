"""Calls of every verb with odd numbers, paths and words, made from the parameters of the commands."""

from pathlib import Path
from types import NoneType
from typing import Any, Final, Literal, get_args, get_origin, get_type_hints

from hypothesis import strategies as st

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


@st.composite
def calls(draw: st.DrawFn, verb: str, command: Any) -> list[str]:
    """The words behind `stillwake` for one of `docs.command_line.commands()`: usual ones, but for one to three."""
    kinds, arguments, options = get_type_hints(command.callback), list[str](), list[str]()
    odd = draw(st.sets(st.sampled_from([one.name for one in command.params]), min_size=1, max_size=3))
    for one in command.params:
        if one.name not in odd and not one.required:
            continue
        if kinds[one.name] is bool:
            options.append(one.opts[0])
            continue
        usual = USUAL.get((verb.split()[0], one.name), "out")
        value = draw(_odd(one.name, kinds[one.name])) if one.name in odd else usual
        # Behind `=`, so that a leading dash is a value; "--" does it for arguments.
        is_option = one.param_type_name == "option"
        (options if is_option else arguments).append(f"{one.opts[0]}={value}" if is_option else value)
    return [*verb.split(), *options, *(["--", *arguments] if arguments else [])]


def _odd(name: str, kind: Any) -> st.SearchStrategy[str]:
    if name == "overrides":
        names = st.sampled_from([setting.name for setting in SETTINGS])
        values = st.sampled_from([*NUMBERS, *WORDS])
        return st.builds(lambda name, value: f"{name}={value}", names, values) | st.sampled_from(WORDS)
    if get_origin(kind) is Literal:
        return st.sampled_from([*get_args(kind), *WORDS])
    # Of a list and of what may be left out, the inner kind.
    kind = next((inner for inner in get_args(kind) if inner is not NoneType), kind)
    values_of: dict[Any, tuple[str, ...]] = {Path: PATHS, int: NUMBERS, float: NUMBERS}
    return st.sampled_from(values_of.get(kind, (*WORDS, *PATHS)))
