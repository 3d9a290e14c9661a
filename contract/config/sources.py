"""Where a setting's default comes from, stated once for a section or in a field's type.

    class MpcConfig(Settings, source=paper("section 2.4.2")):
        horizon: Annotated[int, at_least(2), STEPS, paper("section 2.4")] = 25

A field without a source of its own has that of its section.
"""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Source:
    """Metadata of an `Annotated` type, and of a class of settings: where defaults come from.

    Attributes:
        place: in the paper, or the name of the standard; "" where the default is ours.
        note: how the default follows from it; for ours the reason.
        page: of `docs/`, with more about it; "" for none.
    """

    kind: Literal["paper", "standard", "ours"]
    place: str = ""
    note: str = ""
    page: str = ""

    @property
    def name(self) -> str:
        """Who gives the default, and where: "paper, section 2.1", "SAE J2284-4", "ours"."""
        return self.place if self.kind == "standard" else ", ".join(filter(None, (self.kind, self.place)))


def paper(place: str, note: str = "") -> Source:
    """A number that the paper gives at that place, e.g. "section 2.1"; a note where it follows without being written.

    Numbers of equations are those of the manuscript, counted through.
    """
    return Source("paper", place=place, note=note)


def standard(name: str, note: str) -> Source:
    """A number of a published standard."""
    return Source("standard", place=name, note=note)


def ours(reason: str, *, page: str = "") -> Source:
    """A number of this project: why it is this one, and the page with more about it, if there is one."""
    return Source("ours", note=reason, page=page)
