"""Names of the cases of the proof, by which they are played again.

`flash-0123` is the cut in operation 123 of the whole sequence over a flash memory, `flash-0123+0045` has a second one
in operation 45 after that power-on, `folder-0012` is a cut in call 12 to a folder's files; `.3` behind the kind is the
seed, where it is not 0.
"""

import re
from dataclasses import dataclass
from typing import Final

from contract.errors import StillwakeError

KINDS: Final = ("flash", "folder")
_NAME: Final = re.compile(rf"({'|'.join(KINDS)})(?:\.(\d+))?-(?:(\d+)(?:\+(\d+))?|both-bad)")


@dataclass(frozen=True)
class Case:
    """One case.

    Attributes:
        kind: of memory.
        seed: of what the cut leaves behind.
        first: operation of the sequence; None where no supply is cut and both slots are spoilt.
        second: operation after the power-on, if there is a second cut.
    """

    kind: str
    seed: int
    first: int | None
    second: int | None = None

    def __str__(self) -> str:
        kind = f"{self.kind}.{self.seed}" if self.seed else self.kind
        if self.first is None:
            return f"{kind}-both-bad"
        return f"{kind}-{self.first:04}" + ("" if self.second is None else f"+{self.second:04}")

    @classmethod
    def parse(cls, name: str) -> "Case":
        """Raises StillwakeError for what is no case's name."""
        found = _NAME.fullmatch(name)
        if found is None:
            raise StillwakeError(f"case {name!r}: must be such as flash-0123, flash-0123+0045, folder.2-0012")
        kind, seed, first, second = found.groups()
        return cls(kind, int(seed or 0), None if first is None else int(first), None if second is None else int(second))
