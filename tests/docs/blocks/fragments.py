"""Blocks that are no commands and have no language of their own, by their first lines: what each is, and its check."""

from dataclasses import dataclass
from typing import Final, Literal

from tests.docs.blocks.pages import Block

Kind = Literal["file", "settings", "options", "python", "ini", "json", "words"]
"""file: put where the page's commands read it. settings, options, python, ini and json are read as what they are. words
are for people: a diagram, a formula, what a command prints."""


@dataclass(frozen=True, kw_only=True)
class Fragment:
    """What a block is.

    Attributes:
        name: of a file.
        why: of words, that nothing is checked.
    """

    kind: Kind
    name: str = ""
    why: str = ""


_PRINTED: Final = Fragment(kind="words", why="what the command above prints, with the numbers of one run")

FRAGMENTS: Final = {
    "read model folder -> round ->": Fragment(kind="words", why="a diagram"),
    "tester --ISO-TP--> endpoint": Fragment(kind="words", why="a diagram"),
    "protected part (E2E header first) |": Fragment(kind="words", why="the layout of a frame"),
    "a_k = clip(": Fragment(kind="words", why="a formula"),
    "reward = -Cd": Fragment(kind="words", why="a formula"),
    "episode  role  steps t / t_c": _PRINTED,
    "note   the sensors have no mirror images": _PRINTED,
    "[criteria]": Fragment(kind="file", name="mine.toml"),
    "name,x,y,base": Fragment(kind="file", name="sensors.csv"),
    "t,action,Cd,Cl,roof 1": Fragment(kind="file", name="two_rows.csv"),
    "[operating_point]": Fragment(kind="settings"),
    "bus.interface = ": Fragment(kind="options"),
    "--set bus.interface=": Fragment(kind="options"),
    "--forces monday.blf": Fragment(
        kind="words", why="options of `dataset import`, which tests/stillwake/commands/test_dataset_of_drives.py gives"
    ),
    "[bench]": Fragment(kind="ini"),
    "[Match]": Fragment(kind="ini"),
    '{"time": ': Fragment(kind="json"),
    'np.savez("sweep.npz"': Fragment(kind="python"),
    'with h5py.File("sweep.h5"': Fragment(kind="python"),
}
"""By how the first line begins."""


def fragment(block: Block) -> Fragment | None:
    """What a block without a language is; None if it is not listed, or has a language."""
    if block.language:
        return None
    return next((what for begin, what in FRAGMENTS.items() if block.first.strip().startswith(begin)), None)


def files_of(blocks: list[Block]) -> dict[str, str]:
    """The files that a page's own blocks are, by name."""
    found = [(fragment(block), block.text) for block in blocks]
    return {one.name: text for one, text in found if one is not None and one.kind == "file"}
